"""A CSV file: its header first, so that only the columns that are needed are read."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.formats import ENOUGH, UNKNOWN, recognise
from residual_mpc.logs.readers.table import Header, Table, first_line
from residual_mpc.logs.readers.tables.header_line import header_cells, header_line

HEADER_LIMIT = 4 << 20  # bytes; a first line longer than this is no header
GZIP_RATIO = 12  # text of numbers rarely shrinks more
MISSING = ("", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "<NA>")


@dataclass(frozen=True)
class TextLayout:
    """Attributes:
    names: of the cells of a row.
    separator: between them.
    skip: lines before the first row.
    zipped: whether the file is compressed by gzip.
    """

    path: Path
    names: tuple[str, ...]
    separator: str
    skip: int
    zipped: bool


def text_header(path: Path, size: int, zipped: bool) -> Header:
    """The columns of a CSV file of `size` bytes.

    Raises:
        BadInput: a file that is no UTF-8 text, has no header, or has two columns of one name.
    """
    raw = _first_bytes(path, zipped)
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise BadInput("must be UTF-8 text, got UTF-16", str(path), "save the table as UTF-8")
    if b"\0" in raw:
        raise (recognise(raw[:ENOUGH], path.name) or UNKNOWN).refusal(path)
    lines = raw.removeprefix(b"\xef\xbb\xbf").splitlines()
    above = header_line(lines)
    if above is None:
        raise BadInput("must be a table with a header, got only blank lines", str(path))
    try:
        line = lines[above].decode("utf-8")
    except UnicodeDecodeError as fault:
        raise BadInput(
            "must be a CSV table in UTF-8 or a Parquet table, got other bytes",
            str(path),
            "save the table as UTF-8",
        ) from fault
    if not line.isprintable() and not line.replace("\t", "").isprintable():
        raise BadInput("must be a CSV or Parquet table, got control characters in the header", str(path))
    cells, separator = header_cells(line)
    names = tuple(cell.strip() or f"unnamed {i}" for i, cell in enumerate(cells, start=1))
    layout = TextLayout(path, names, separator, above + 1, zipped)
    return Header(path, names, float(size) * (GZIP_RATIO if zipped else 1), partial(_read, layout))


def _first_bytes(path: Path, zipped: bool) -> bytes:
    try:
        with gzip.open(path) if zipped else open(path, "rb") as file:
            raw: bytes = file.read(HEADER_LIMIT)
    except (EOFError, gzip.BadGzipFile, gzip.zlib.error) as fault:  # type: ignore[attr-defined]
        raise BadInput(f"the compressed file is damaged ({fault})", str(path), "export it again") from fault
    return raw


def _read(layout: TextLayout, columns: Sequence[str]) -> Table:
    table, ragged = _parse(layout, columns, ".")
    warnings = []
    if layout.separator != ",":
        mark = {";": "semicolons", "\t": "tabs"}[layout.separator]
        warnings.append(f"columns are separated by {mark} instead of commas")
        if _has_decimal_commas(table):
            table, ragged = _parse(layout, columns, ",")
            warnings.append("numbers use decimal commas")
    if ragged:
        number, cells, text = ragged[0]
        if "\n" in text:
            raise BadInput(f"unclosed quote in data row {number + 1}: {text[:60]!r}", str(layout.path))
        if len(ragged) > 1 or cells > len(layout.names) or number < table.num_rows:
            raise BadInput(
                f"data row {number + 1} must have {len(layout.names)} cells, got {cells}: {text[:80]!r}",
                str(layout.path),
                "use one separator, the same number of cells in every row, and decimal points",
            )
        warnings.append("the last row is incomplete and was dropped")
    return Table({name: table.column(name) for name in columns}, tuple(warnings))


def _parse(layout: TextLayout, columns: Sequence[str], decimal: str) -> tuple[Any, list[tuple[int, int, str]]]:
    """The rows, and those that do not fit the header as (0-based data row, cells, text)."""
    import pyarrow as pa

    ragged: list[tuple[int, int, str]] = []

    def note(row: Any) -> str:
        ragged.append((int(row.number or 0) - layout.skip - 1, int(row.actual_columns), str(row.text)))
        return "skip"

    try:
        return _arrow_csv(layout, columns, decimal, None), ragged
    except (pa.ArrowException, OSError, ValueError) as fault:
        message = first_line(fault)
        if "Empty CSV" in message or "Could not skip" in message:
            raise BadInput("the table has no rows", str(layout.path), "remove it") from fault
        # Arrow hands a row on as text, which it can only be when it is UTF-8
        if "columns, got" not in message or not _is_text(layout):
            raise BadInput(f"the table cannot be read ({message})", str(layout.path)) from fault
    return _arrow_csv(layout, columns, decimal, note), ragged


def _arrow_csv(layout: TextLayout, columns: Sequence[str], decimal: str, note: Callable[[Any], str] | None) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pc

    with pa.input_stream(str(layout.path), compression="gzip" if layout.zipped else None) as stream:
        return pc.read_csv(
            stream,
            # one thread where rows are noted: only then does Arrow know their numbers
            read_options=pc.ReadOptions(
                column_names=list(layout.names),
                skip_rows=layout.skip,
                use_threads=note is None,
                block_size=HEADER_LIMIT,
            ),
            parse_options=pc.ParseOptions(delimiter=layout.separator, invalid_row_handler=note),
            convert_options=pc.ConvertOptions(
                include_columns=list(columns),
                null_values=list(MISSING),
                strings_can_be_null=True,
                decimal_point=decimal,
                timestamp_parsers=[],
            ),
        )


def _is_text(layout: TextLayout) -> bool:
    try:
        opened = (
            gzip.open(layout.path, "rt", encoding="utf-8") if layout.zipped else open(layout.path, encoding="utf-8")
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
