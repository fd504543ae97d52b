"""Which column of a table stands for which name of the log format."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import SPECIAL, did_you_mean, group, is_measured


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


def lay_out(names: Sequence[str], log: Mapping[str, str]) -> Layout:
    """Name a table's columns by the robot file's [log] first, and by their own names where it says nothing.

    A column that [log] renames within its group (position to position) no longer answers to its own name; one
    that serves another group (a wheel speed as a command) keeps it.
    """
    columns = {name: column for name, column in log.items() if column in names}
    absent = {name: column for name, column in log.items() if column not in names and name not in names}
    moved = {column for name, column in columns.items() if name != column and _kind(name) == _kind(column)}
    for name in names:
        if _kind(name) is not None and name not in columns and name not in moved:
            columns[name] = name
    place = {name: i for i, name in enumerate(names)}
    columns = dict(sorted(columns.items(), key=lambda item: place[item[1]]))
    driving = {column for name, column in columns.items() if group(name) == "command"}
    served = frozenset(name for name, column in columns.items() if is_measured(name) and column in driving)
    extra = tuple(name for name in names if name not in columns.values())
    return Layout(columns, served, extra, absent)


def recognised(names: Iterable[str], robot: ColumnNames) -> set[str]:
    """The columns of a table that some run may need."""
    sources = {column for log in robot.logs for column in log.values()}
    return {name for name in names if _kind(name) is not None or name in sources}


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
                    did_you_mean(column, known),
                )


def _kind(name: str) -> str | None:
    return name if name in SPECIAL else group(name)
