"""A CSV or Parquet file: its header first, so that only the columns that are needed are read."""

from __future__ import annotations

import csv
import gzip
import io
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.formats import ENOUGH, UNKNOWN, recognise
from residual_mpc.logs.readers.lists import Element, element_of, find_elements, note_of

HEADER_LIMIT = 4 << 20  # bytes; a first line longer than this is no header
GZIP_RATIO = 12  # text of numbers rarely shrinks more
MISSING = ("", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "<NA>")


@dataclass(frozen=True)
class Header:
    """What a table says about itself before its rows are read.

    Attributes:
        path: the file.
        names: its columns, in order, no two alike; a list column stands as its elements.
        size: estimated memory of all columns as numbers, bytes.
        separator: between the cells of a CSV file; empty for Parquet.
        skip: lines of a CSV file before its first row.
        zipped: whether a CSV file is compressed by gzip.
        elements: of list columns, by name.
        note: what became of its list columns, empty without any.
    """

    path: Path
    names: tuple[str, ...]
    size: float
    separator: str
    skip: int
    zipped: bool
    elements: Mapping[str, Element] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Table:
    """The rows.

    Attributes:
        columns: by name, as Arrow arrays.
        warnings: what was mended on the way.
        faults: columns that cannot be had, by name, and why.
    """

    columns: dict[str, Any]
    warnings: tuple[str, ...]
    faults: Mapping[str, str] = field(default_factory=dict)


def read_header(path: Path) -> Header:
    """The column names of a table.

    Raises:
        BadInput: an empty, unreadable or damaged file, one of another format, or two columns of one name.
    """
    try:
        with open(path, "rb") as file:
            start = file.read(ENOUGH)
        size = os.stat(path).st_size
        if not start:
            raise BadInput("must be a table with a header, got an empty file", str(path))
        if start.startswith(b"PAR1"):
            return _parquet_header(path)
        other = recognise(start, path.name)
        if other is not None:
            raise other.refusal(path)
        if path.suffix.lower() == ".parquet":
            raise BadInput("must be a Parquet file, got another format", str(path), "export it again as Parquet or CSV")
        return _csv_header(path, size, zipped=start[:2] == b"\x1f\x8b")
    except OSError as fault:
        raise BadInput(f"cannot be read ({fault.strerror or fault})", str(path)) from fault


def read_table(header: Header, columns: Sequence[str]) -> Table:
    """The named columns of a table.

    Raises:
        BadInput: a damaged file, or rows that do not fit the header.
    """
    return _read_csv(header, columns) if header.separator else _read_parquet(header, columns)


def _parquet_header(path: Path) -> Header:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            lists = find_elements(file, path)
            names = tuple(n for column in file.schema_arrow.names for n in lists.get(column, (str(column),)))
            rows = file.metadata.num_rows
    except (pa.ArrowException, OSError, ValueError) as fault:
        what = f"the Parquet file is damaged ({_first_line(fault)})"
        raise BadInput(what, str(path), "export it again") from fault
    _no_twins(names, path)
    elements = {name: element for column in lists.values() for name, element in column.items()}
    return Header(path, names, 8.0 * rows * len(names), "", 0, False, elements, note_of(lists))


def _read_parquet(header: Header, columns: Sequence[str]) -> Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(header.path) as file:  # a dataset would invent columns from folder names
            needed = {header.elements[name].column if name in header.elements else name for name in columns}
            table = file.read(columns=sorted(needed), use_pandas_metadata=False)
    except (pa.ArrowException, OSError, ValueError) as fault:
        what = f"the Parquet file is damaged ({_first_line(fault)})"
        raise BadInput(what, str(header.path), "export it again") from fault
    found, faults = {}, {}
    for name in columns:
        element = header.elements.get(name)
        column = table.column(name) if element is None else element_of(table.column(element.column), element)
        if isinstance(column, str):
            faults[name] = column
        else:
            found[name] = column
    return Table(found, (), faults)


def _csv_header(path: Path, size: int, zipped: bool) -> Header:
    raw = _first_bytes(path, zipped)
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise BadInput("must be UTF-8 text, got UTF-16", str(path), "save the table as UTF-8")
    if b"\0" in raw:
        raise (recognise(raw[:ENOUGH], path.name) or UNKNOWN).refusal(path)
    lines = raw.removeprefix(b"\xef\xbb\xbf").splitlines()
    blank = next((i for i, line in enumerate(lines) if line.strip()), len(lines))
    if blank == len(lines):
        raise BadInput("must be a table with a header, got only blank lines", str(path))
    try:
        line = lines[blank].decode("utf-8")
    except UnicodeDecodeError as fault:
        raise BadInput(
            "must be a CSV table in UTF-8 or a Parquet table, got other bytes",
            str(path),
            "save the table as UTF-8",
        ) from fault
    if not line.isprintable() and not line.replace("\t", "").isprintable():
        raise BadInput("must be a CSV or Parquet table, got control characters in the header", str(path))
    separator = max(",;\t", key=lambda mark: (line.count(mark), -",;\t".index(mark)))
    cells = next(csv.reader(io.StringIO(line), delimiter=separator, skipinitialspace=True), [])
    cells[0] = cells[0].removeprefix("#")  # numpy.savetxt marks its header as a comment
    names = tuple(cell.strip() or f"unnamed {i}" for i, cell in enumerate(cells, start=1))
    _no_twins(names, path)
    size *= GZIP_RATIO if zipped else 1
    return Header(path, names, float(size), separator, blank + 1, zipped)


def _first_bytes(path: Path, zipped: bool) -> bytes:
    try:
        with gzip.open(path) if zipped else open(path, "rb") as file:
            raw: bytes = file.read(HEADER_LIMIT)
    except (EOFError, gzip.BadGzipFile, gzip.zlib.error) as fault:  # type: ignore[attr-defined]
        raise BadInput(f"the compressed file is damaged ({fault})", str(path), "export it again") from fault
    return raw


def _read_csv(header: Header, columns: Sequence[str]) -> Table:
    table, ragged = _parse(header, columns, ".")
    warnings = []
    if header.separator != ",":
        mark = {";": "semicolons", "\t": "tabs"}[header.separator]
        warnings.append(f"columns are separated by {mark} instead of commas")
        if _has_decimal_commas(table):
            table, ragged = _parse(header, columns, ",")
            warnings.append("numbers use decimal commas")
    if ragged:
        number, cells, text = ragged[0]
        if "\n" in text:
            raise BadInput(f"unclosed quote in data row {number + 1}: {text[:60]!r}", str(header.path))
        if len(ragged) > 1 or cells > len(header.names) or number < table.num_rows:
            raise BadInput(
                f"data row {number + 1} must have {len(header.names)} cells, got {cells}: {text[:80]!r}",
                str(header.path),
                "use one separator, the same number of cells in every row, and decimal points",
            )
        warnings.append("the last row is incomplete and was dropped")
    return Table({name: table.column(name) for name in columns}, tuple(warnings))


def _parse(header: Header, columns: Sequence[str], decimal: str) -> tuple[Any, list[tuple[int, int, str]]]:
    """The rows, and those that do not fit the header as (0-based data row, cells, text)."""
    import pyarrow as pa

    ragged: list[tuple[int, int, str]] = []

    def note(row: Any) -> str:
        ragged.append((int(row.number or 0) - header.skip - 1, int(row.actual_columns), str(row.text)))
        return "skip"

    try:
        return _arrow_csv(header, columns, decimal, None), ragged
    except (pa.ArrowException, OSError, ValueError) as fault:
        message = _first_line(fault)
        if "Empty CSV" in message or "Could not skip" in message:
            raise BadInput("the table has no rows", str(header.path), "remove it") from fault
        # Arrow hands a row on as text, which it can only be when it is UTF-8
        if "columns, got" not in message or not _is_text(header):
            raise BadInput(f"the table cannot be read ({message})", str(header.path)) from fault
    return _arrow_csv(header, columns, decimal, note), ragged


def _arrow_csv(header: Header, columns: Sequence[str], decimal: str, note: Callable[[Any], str] | None) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pc

    with pa.input_stream(str(header.path), compression="gzip" if header.zipped else None) as stream:
        return pc.read_csv(
            stream,
            # one thread where rows are noted: only then does Arrow know their numbers
            read_options=pc.ReadOptions(
                column_names=list(header.names),
                skip_rows=header.skip,
                use_threads=note is None,
                block_size=HEADER_LIMIT,
            ),
            parse_options=pc.ParseOptions(delimiter=header.separator, invalid_row_handler=note),
            convert_options=pc.ConvertOptions(
                include_columns=list(columns),
                null_values=list(MISSING),
                strings_can_be_null=True,
                decimal_point=decimal,
                timestamp_parsers=[],
            ),
        )


def _is_text(header: Header) -> bool:
    try:
        opened = (
            gzip.open(header.path, "rt", encoding="utf-8") if header.zipped else open(header.path, encoding="utf-8")
        )
        with opened as file:
            while file.read(1 << 20):
                pass
    except (UnicodeDecodeError, OSError, EOFError):
        return False
    return True


def _has_decimal_commas(table: Any) -> bool:
    import pyarrow as pa
    import pyarrow.compute as pc

    pattern = r"^\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*$"
    texts = [column.slice(0, 1000) for column in table.columns if pa.types.is_string(column.type)]
    return any(bool(pc.any(pc.match_substring_regex(text, pattern)).as_py()) for text in texts)


def _no_twins(names: Sequence[str], path: Path) -> None:
    twins = [name for name, count in Counter(names).items() if count > 1]
    if twins:
        raise BadInput(f"column {twins[0]!r} appears twice in the header", str(path), "rename one of them")


def _first_line(fault: Exception) -> str:
    return (str(fault).splitlines() or [type(fault).__name__])[0][:200]
