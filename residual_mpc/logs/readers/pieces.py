"""The runs of tables: which rows belong to each, its cells as numbers, and what the runs are called."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from residual_mpc.errors import BadInput
from residual_mpc.logs.clock import IntArray
from residual_mpc.logs.readers.cells import labels, numbers, numbers_or_none, whole_numbers
from residual_mpc.logs.readers.dates import as_nanoseconds
from residual_mpc.logs.readers.find import stem
from residual_mpc.logs.readers.layout import ColumnNames, lay_out, recognised
from residual_mpc.logs.readers.table import Header, Remark
from residual_mpc.logs.run import FloatArray


@dataclass(frozen=True)
class Piece:
    """The rows of one run within a table."""

    header: Header
    label: str  # the run's name within its file, empty where that holds one
    rows: NDArray[np.intp]  # (m,) rows of the table
    cells: dict[str, FloatArray]  # column of numbers -> (rows of the table,)
    whole: dict[str, IntArray]  # those that may be the time and hold whole numbers alone
    dates: frozenset[str]  # those that may be the time and held dates, which are now ns since 1970
    left_out: tuple[str, ...]  # unknown columns that were not read
    warnings: tuple[str, ...]
    remarks: tuple[Remark, ...]


def pieces_of(header: Header, names: tuple[str, ...], robot: ColumnNames) -> Iterator[Piece]:
    """A table's runs in the order in which they begin; of its columns only `names` are read."""
    where = header.where
    table = header.read(names)
    needed = recognised(header, robot)
    layout = lay_out(header, robot.log)
    run_column = layout.columns.get("run")
    clocks = {lay_out(header, log).columns.get("t") for log in robot.logs}
    columns = dict(table.columns)
    dates = set()
    for name in columns.keys() & clocks:
        if name != layout.columns.get("t") and name not in needed:
            continue  # the time of another variant
        stamps = as_nanoseconds(columns[name], "t", where)
        if stamps is not None:
            columns[name] = stamps
            dates.add(name)
    cells = {}
    for name in names:
        if name == run_column:
            continue
        if name in table.faults:
            if name in needed:
                raise BadInput(table.faults[name], where, "write lists of equal length, or one column per element")
            continue
        shown = "t" if name == layout.columns.get("t") else name  # the time has a message of its own
        values = numbers(columns[name], shown, where) if name in needed else None
        values = numbers_or_none(columns[name]) if values is None else values
        if values is not None:
            cells[name] = values
    left_out = tuple(name for name in header.names if name not in names)
    counts = {name: whole_numbers(columns[name]) for name in cells if name in clocks}
    whole = {name: values for name, values in counts.items() if values is not None}
    rest = (cells, whole, frozenset(dates), left_out, table.warnings, (*header.remarks, *table.remarks))
    count = max((len(column) for column in table.columns.values()), default=0)
    if count == 0:
        raise BadInput("the table has no rows", where, "remove it, or record the run again")
    if run_column is None:
        yield Piece(header, header.label, np.arange(count), *rest)
        return
    of_row = labels(table.columns[run_column], run_column, where)
    unique = {label: i for i, label in enumerate(dict.fromkeys(of_row))}
    codes = np.array([unique[label] for label in of_row])
    order = np.argsort(codes, kind="stable")
    splits = np.split(order, np.flatnonzero(np.diff(codes[order])) + 1)
    for label, rows in zip(unique, splits, strict=True):
        yield Piece(header, f"{header.label}/{label}" if header.label else label, rows, *rest)


def unique_names(pieces: Sequence[Piece]) -> list[str]:
    """The shortest names that tell the runs apart: the run's own, or behind its file and folders."""
    choices = []
    for piece in pieces:
        parts = [*piece.header.path.resolve().parent.parts[1:], stem(piece.header.path)]
        tail = [piece.label] if piece.label else []
        full = parts + tail
        choices.append(["/".join(full[-k:]) for k in range(1, len(full) + 1)])
    level = [0] * len(pieces)
    while True:
        names = [choice[k] for choice, k in zip(choices, level, strict=True)]
        counts: dict[str, int] = {}
        for name in names:
            counts[name] = counts.get(name, 0) + 1
        clashing = [i for i, name in enumerate(names) if counts[name] > 1 and level[i] + 1 < len(choices[i])]
        if not clashing:
            return names
        for i in clashing:
            level[i] += 1
