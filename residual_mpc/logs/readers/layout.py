"""Which column of a table stands for which name of the log format."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import SPECIAL, did_you_mean, group, is_measured
from residual_mpc.models.robot_file import RobotFile


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


def logs_of(robot: RobotFile) -> tuple[Mapping[str, str], ...]:
    """Every [log] that the robot file may apply to a run: its own, and its variants' on top of it."""
    variants = [v.overrides["log"] for v in robot.variants if "log" in v.overrides]
    return (robot.log, *({**robot.log, **v} for v in variants if isinstance(v, Mapping)))


def recognised(names: Iterable[str], robot: RobotFile) -> set[str]:
    """The columns of a table that some run may need."""
    sources = {column for log in logs_of(robot) for column in log.values()}
    return {name for name in names if _kind(name) is not None or name in sources}


def check_log(robot: RobotFile, tables: Sequence[Sequence[str]]) -> None:
    """Refuse a [log] that names a column which no table of the call has.

    Raises:
        BadInput: with the nearest column that the tables do have.
    """
    known = dict.fromkeys(name for names in tables for name in names)
    for log in logs_of(robot):
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
