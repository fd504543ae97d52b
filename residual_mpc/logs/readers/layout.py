"""Which column of a table stands for which name of the log format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import SPECIAL, did_you_mean, group, is_measured
from residual_mpc.logs.readers.table import Header


class ColumnNames(Protocol):
    """What a robot file says of the columns of its logs: each [log] maps a name of the log format to a column."""

    @property
    def source(self) -> str:
        """Where that was read, for messages."""
        ...

    @property
    def log(self) -> Mapping[str, str]:
        """The [log] of the robot, whose variants may override entries of it."""
        ...

    @property
    def logs(self) -> tuple[Mapping[str, str], ...]:
        """Every [log] that may apply to a run: the robot's, and its variants' on top of it."""
        ...

    def log_of(self, run_name: str) -> Mapping[str, str]:
        """The [log] that applies to a run."""
        ...

    def wheels_of(self, run_name: str) -> tuple[float, float] | None:
        """(wheel radius, track width) in a run, m; None for a robot without these parameters."""
        ...


@dataclass(frozen=True)
class Layout:
    """The columns of one table, by the names of the log format.

    Attributes:
        columns: log name -> column of the table, in the table's order; includes `t` and `run` where they are.
        served_as_command: measured log names whose column also serves as a command.
        extra: the table's other columns.
        absent: entries of [log] whose column this table lacks.
    """

    columns: Mapping[str, str]
    served_as_command: frozenset[str]
    extra: tuple[str, ...]
    absent: Mapping[str, str]


def lay_out(header: Header, log: Mapping[str, str]) -> Layout:
    """Name a table's columns by the robot file's [log] first, by their own names where it says nothing, and last by
    what the file's format says of them.

    A column that [log] renames within its group (position to position) no longer answers to its own name; one
    that serves another group (a wheel speed as a command) keeps it.
    """
    names = header.names
    columns = {name: column for name, column in log.items() if column in names}
    absent = {name: column for name, column in log.items() if column not in names and name not in names}
    moved = {column for name, column in columns.items() if name != column and _kind(name) == _own_kind(header, column)}
    for name in names:
        if _kind(name) is not None and name not in columns and name not in moved:
            columns[name] = name
    for name, column in header.preferred.items():
        if name not in columns and column not in moved:
            columns[name] = column
            absent.pop(name, None)
    place = {name: i for i, name in enumerate(names)}
    columns = dict(sorted(columns.items(), key=lambda item: place[item[1]]))
    driving = {column for name, column in columns.items() if group(name) == "command"}
    served = frozenset(name for name, column in columns.items() if is_measured(name) and column in driving)
    extra = tuple(name for name in names if name not in columns.values())
    return Layout(columns, served, extra, absent)


def recognised(header: Header, robot: ColumnNames) -> set[str]:
    """The columns of a table that some run may need."""
    sources = {column for log in robot.logs for column in log.values()}
    own = {name for name in header.names if _kind(name) is not None or name in sources}
    return own | {column for log in robot.logs for column in lay_out(header, log).columns.values()}


def worth_reading(header: Header, robot: ColumnNames) -> tuple[str, ...]:
    """The columns to keep: all of a table, and of a recording those of the topics that some run needs, whose stamps
    become its rows; all of them where it needs none."""
    needed = {header.topics[name] for name in recognised(header, robot) if name in header.topics}
    if not needed:
        return header.names
    return tuple(name for name in header.names if header.topics.get(name, "") in needed or name not in header.topics)


def check_log(robot: ColumnNames, tables: Sequence[Sequence[str]]) -> None:
    """Refuse a [log] that names a column which no table of the call has.

    Raises:
        BadInput: with the nearest column that the tables do have.
    """
    known = dict.fromkeys(name for names in tables for name in names)
    for log in robot.logs:
        for name, column in log.items():
            # a table that uses the log's own name already needs no renaming
            if column not in known and (name not in known or name in log.values()):
                raise BadInput(
                    f'[log] maps "{name}" to column {column!r}, which no table has',
                    robot.source,
                    did_you_mean(column, (c for c in known if c not in log.values())),
                )


def _own_kind(header: Header, column: str) -> str | None:
    """The kind that a column has by its own name, or by what its format says of it."""
    return _kind(column) or _kind(header.meanings.get(column, ""))


def _kind(name: str) -> str | None:
    return name if name in SPECIAL else group(name)
