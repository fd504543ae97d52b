"""New lines of a log as rows of a run, by the readers that every other command uses."""

from __future__ import annotations

import csv
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import PER_ACTUATOR, group, is_measured
from residual_mpc.logs.readers.body_velocity import ANGULAR, LINEAR
from residual_mpc.logs.readers.headers import read_headers
from residual_mpc.logs.readers.layout import ColumnNames, lay_out
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.logs.run import FloatArray, Run, hold
from residual_mpc.monitoring.arrivals.follow import Arrival, delimiter, is_number
from residual_mpc.monitoring.settings import ArrivalSettings


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one run. stamps (n,) s by the log's own clock; columns: as `Run.columns`, each (n,)."""

    name: str
    stamps: FloatArray
    columns: Mapping[str, FloatArray]
    served_as_command: frozenset[str]
    source: str

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, first: int, last: int) -> Rows:
        """The rows from `first` to before `last`; what was sent before them is still held in the first."""
        columns = {k: v[first:last] for k, v in self.columns.items()}
        for k, v in self.columns.items():
            if group(k) in PER_ACTUATOR and first < last and not np.isfinite(v[first]):
                columns[k] = columns[k].copy()
                columns[k][0] = hold(v)[first]
        return replace(self, stamps=self.stamps[first:last], columns=columns)


def rows_of(run: Run) -> Rows:
    return Rows(run.name, run.start + run.t, run.columns, run.served_as_command, run.source)


def stacked(parts: list[Rows]) -> Rows:
    """Rows below each other; NaN where one of them lacks a column."""
    names = dict.fromkeys(k for p in parts for k in p.columns)
    columns = {k: np.concatenate([p.columns.get(k, np.full(len(p), np.nan)) for p in parts]) for k in names}
    return replace(parts[-1], stamps=np.concatenate([p.stamps for p in parts]), columns=columns)


class RowReader:
    """Reads the arrivals of one log.

    The last line is read again with the next block, its empty cells filled with what was last in them, so that commands
    that are logged when they change are still held there.
    """

    def __init__(self, robot: ColumnNames, actuators: Sequence[str], settings: ArrivalSettings) -> None:
        self._robot, self._actuators, self._settings = robot, actuators, settings
        self._waiting: tuple[str, ...] = ()
        self._carried: tuple[str, ...] = ()
        self._begun = False
        self.left_out: list[str] = []  # lines that could not be read, until somebody takes them

    def read(self, arrival: Arrival) -> Iterator[Rows]:
        """The new rows, by run; the first of them may be one that was read before.

        Lines that are unlike the others, such as half of one, are left out where a block cannot be read with them.
        Raises BadInput for a log that cannot be read from its beginning, and for a block of one that cannot be read
        later on, which is then left out as a whole.
        """
        if arrival.file is not None:
            yield from map(rows_of, read_runs([arrival.file], self._robot).runs)
            return
        if arrival.fresh:
            self._waiting, self._carried, self._begun = (), (), False
            with _as_file(arrival, ()) as path:
                _check_header(path, self._robot, self._actuators, arrival.source)
        lines = (*self._carried, *self._waiting, *arrival.lines)
        if len(lines) < 2:
            self._waiting = lines
            return
        try:
            runs = self._runs(arrival, lines)
        except BadInput as error:
            if not self._begun and len(lines) < self._settings.header_rows:
                self._waiting = lines  # an actuator may still wait for its first command
                return
            good = _usual(arrival.header, lines)
            try:
                if not 2 <= len(good) < len(lines):
                    raise error
                runs = self._runs(arrival, good)
            except BadInput:
                self._waiting = ()
                raise BadInput(error.what, arrival.source, error.remedy) from error
            usual = frozenset(good)
            self.left_out += [line for line in lines if line not in usual]
            lines = good
        self._begun, self._waiting, self._carried = True, (), (_last_filled(arrival.header, lines),)
        yield from (replace(rows_of(run), source=arrival.source) for run in runs)

    def _runs(self, arrival: Arrival, lines: tuple[str, ...]) -> Sequence[Run]:
        with _as_file(arrival, lines) as path:
            return read_runs([path], self._robot).runs


class _as_file:
    """A block of a log as a file of the log's own name, which a robot file's variants may refer to."""

    def __init__(self, arrival: Arrival, lines: tuple[str, ...]) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._path = Path(self._folder.name) / f"{arrival.name}.csv"
        self._path.write_text("\n".join((arrival.header, *lines)) + "\n", encoding="utf-8")

    def __enter__(self) -> Path:
        return self._path

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()


def _usual(header: str, lines: tuple[str, ...]) -> tuple[str, ...]:
    """The lines with as many cells as the header, and numbers or nothing where most lines have that."""
    mark = delimiter(header)
    cells, *rows = (next(csv.reader([line], delimiter=mark), []) for line in (header, *lines))
    count = len(cells)
    numbers = [[is_number(cell) for cell in row] for row in rows]
    whole = np.array([of for of in numbers if len(of) == count], dtype=bool).reshape(-1, count)
    expected = whole.mean(axis=0) > 0.5 if len(whole) else np.zeros(count, dtype=bool)
    return tuple(
        line for line, of in zip(lines, numbers, strict=True) if len(of) == count and np.all(np.array(of) | ~expected)
    )


def _last_filled(header: str, lines: tuple[str, ...]) -> str:
    """The last line, its empty cells as they were last filled."""
    mark = delimiter(header)
    last = [""] * len(header.split(mark))
    for row in csv.reader(lines, delimiter=mark):
        if len(row) == len(last):
            last = [new if new.strip() else old for new, old in zip(row, last, strict=True)]
    return mark.join(last)


def _check_header(path: Path, robot: ColumnNames, actuators: Sequence[str], source: str) -> None:
    """Raises BadInput for a table without time, command or measured column, or without a command of this robot's
    actuators: no number of rows would mend that."""
    (header,) = read_headers(path)
    columns = lay_out(header, robot.log_of(path.stem)).columns
    commands, wanted = {n for n in columns if group(n) == "command"}, [f"command.{a}" for a in actuators]
    body = robot.wheels_of(path.stem) is not None and {LINEAR, ANGULAR} <= commands  # become wheel speeds
    there = {
        "'t' (time stamps in s)": "t" in columns,
        "command.<actuator>": bool(commands),
        " or ".join(wanted): body or not commands.isdisjoint(wanted),
        "of a measurement (position.<joint>, pose.x, ...)": any(is_measured(n) for n in columns),
    }
    for what, found in there.items():
        if not found:
            raise BadInput(
                f"no column {what} was found; the columns are {', '.join(header.names[:30])}",
                source,
                "map the columns under [log] in the robot file",
            )
