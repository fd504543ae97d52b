"""Tables as they came: every column that holds numbers, under its own name, run by run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.words import TIME_WORDS, ColumnName, read_words, tokens
from residual_mpc.logs.columns import RUNS as RUN_WORDS
from residual_mpc.logs.columns import group, is_measured
from residual_mpc.logs.readers.cells import labels, numbers_or_none
from residual_mpc.logs.readers.dates import as_nanoseconds
from residual_mpc.logs.readers.find import find_tables, stem
from residual_mpc.logs.readers.headers import read_headers
from residual_mpc.logs.readers.read import MEMORY_LIMIT
from residual_mpc.logs.readers.table import Header
from residual_mpc.logs.run import FloatArray

RUNS = 0.2  # share of the rows up to which the values of a column may be runs


@dataclass(frozen=True)
class Recording:
    """Attributes:
    name: the file's stem, and the run's label where a table holds several.
    source: the file.
    columns: by the table's own names, each (n,), NaN where a cell is empty; dates are ns since 1970.
    texts: names of columns that hold no numbers.
    dates: names of columns that hold dates.
    run_column: which tells the runs of the table apart, None where it holds one.
    label: the value of run_column, empty without one.
    notes: how the table was read, where that needs a word.
    hints: column -> text that describes it better than its name, if the file's format defines it.
    preferred: name of the log format -> the column that the file's format has for it.
    doubles: columns with the same quantity as a preferred one.
    unit: of the column `t`, if the file's format fixes it.
    """

    name: str
    source: Path
    columns: Mapping[str, FloatArray]
    texts: tuple[str, ...] = ()
    dates: frozenset[str] = frozenset()
    run_column: str | None = None
    label: str = ""
    notes: tuple[str, ...] = ()
    hints: Mapping[str, str] = field(default_factory=dict)
    preferred: Mapping[str, str] = field(default_factory=dict)
    doubles: frozenset[str] = frozenset()
    unit: str | None = None

    @property
    def rows(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def read_recordings(paths: Sequence[str | Path]) -> tuple[Recording, ...]:
    """Every run behind paths.

    Raises BadInput for a table that cannot be read, or holds no column of numbers or fewer than two rows, and for
    tables that need more memory than MEMORY_LIMIT.
    """
    headers = [header for path in find_tables(paths) for header in read_headers(path)]
    size = sum(header.size for header in headers)
    if size > MEMORY_LIMIT:
        raise BadInput(
            f"`init` reads every column, which needs about {size / 2**30:.3g} GiB of memory, more than the limit of"
            f" {MEMORY_LIMIT / 2**30:.3g} GiB",
            str(max(headers, key=lambda header: header.size).path),
            "give one or two short runs; the robot file serves the others as well",
        )
    return tuple(recording for header in headers for recording in _read(header))


def _read(header: Header) -> list[Recording]:
    path = header.path
    table = header.read(header.names)
    cells: dict[str, FloatArray] = {}
    texts, dates = [], []
    for name, column in table.columns.items():
        values = numbers_or_none(column)
        if values is None:
            values = _dates_as_numbers(column, name, str(path))
            if values is not None:
                dates.append(name)
        if values is None:
            texts.append(name)
        else:
            cells[name] = values
    texts += list(table.faults)
    rows = len(next(iter(table.columns.values()), ()))
    if rows < 2:
        what = f"a run must have at least two samples, got {'one' if rows == 1 else 'none'}"
        raise BadInput(what, str(path), "remove the table, or record the run again")
    if not cells:
        raise BadInput("no column is numeric", str(path), "use decimal points, and leave cells of missing values empty")
    name = f"{stem(path)}/{header.label}" if header.label else stem(path)
    notes = [header.note, *(r.message for r in (*header.remarks, *table.remarks) if r.severity != "error")]
    whole = Recording(
        name,
        path,
        cells,
        tuple(texts),
        frozenset(dates),
        label=header.label,
        notes=tuple(note for note in notes if note),
        hints={column: _hint(header, column, meaning) for column, meaning in header.meanings.items()},
        preferred=header.preferred,
        unit=header.unit,
        doubles=frozenset(
            column
            for column, meaning in header.meanings.items()
            if is_measured(meaning) and header.preferred.get(meaning, column) != column
        ),
    )
    run_column = _run_column(table.columns, cells, rows)
    return [whole] if run_column is None else _split(whole, run_column, table.columns[run_column])


def _hint(header: Header, column: str, meaning: str) -> str:
    """The group of a column in the log format, and its name without its topic."""
    return f"{group(meaning) or meaning} {column.removeprefix(header.topics.get(column, ''))}"


def column_words(names: Sequence[str], recordings: Sequence[Recording]) -> dict[str, ColumnName]:
    """The words in the columns' names or hints, without the columns that repeat the quantity of another."""
    hints = {column: hint for r in recordings for column, hint in r.hints.items()}
    doubles = frozenset[str]().union(*(r.doubles for r in recordings))
    return {name: replace(read_words(hints.get(name, name)), name=name) for name in names if name not in doubles}


def _run_column(columns: Mapping[str, Any], cells: Mapping[str, FloatArray], rows: int) -> str | None:
    """The first column whose name is a run's and whose values are few."""
    for name, column in columns.items():
        if name == "run":
            return name
        if not set(tokens(name)) & RUN_WORDS or set(tokens(name)) - RUN_WORDS - {"index", "id", "number", "name"}:
            continue
        kinds = len(np.unique(cells[name])) if name in cells else len(set(column.to_pylist()))
        if 1 < kinds <= max(2.0, RUNS * rows):
            return name
    return None


def _split(whole: Recording, run_column: str, column: Any) -> list[Recording]:
    of_row = np.array(labels(column, run_column, str(whole.source)))
    parts = []
    for label in dict.fromkeys(of_row.tolist()):
        rows = np.flatnonzero(of_row == label)
        cells = {name: values[rows] for name, values in whole.columns.items() if name != run_column}
        name = f"{whole.name}/{label}"
        label = f"{whole.label}/{label}" if whole.label else label
        parts.append(replace(whole, name=name, columns=cells, run_column=run_column, label=label))
    return parts


def _dates_as_numbers(column: Any, name: str, where: str) -> FloatArray | None:
    """(n,) ns since 1970 of a column of dates that every command reads, None where it holds anything else. Raises
    BadInput as reading does."""
    import pyarrow as pa

    if not pa.types.is_timestamp(column.type) and not set(tokens(name)) & TIME_WORDS:
        return None
    stamps = as_nanoseconds(column, name, where)
    return None if stamps is None else np.array(stamps.to_numpy(), dtype=np.float64)
