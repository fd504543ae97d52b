"""Time stamps that are dates with times of day (ISO 8601), as whole nanoseconds."""

from __future__ import annotations

from typing import Any

from residual_mpc.errors import BadInput

EXAMPLE = "2026-11-28 02:05:41.120"


def as_nanoseconds(column: Any, name: str, where: str) -> Any | None:
    """An Arrow column of dates as one of whole ns since 1970, in UTC where it states no other zone; None for a column
    that holds anything else.

    Raises:
        BadInput: a text that is no date below one that is, stamps with and without a zone, or a date that 64 bits
            cannot count.
    """
    import pyarrow as pa

    kind = column.type
    if pa.types.is_dictionary(kind):
        column, kind = column.cast(kind.value_type), kind.value_type
    if pa.types.is_timestamp(kind):
        dates = _cast(column, kind.tz)
        if dates is None:
            raise BadInput(f"column {name!r} must be dates in the years 1678 to 2261", where, "correct the dates")
        return dates.cast(pa.int64())
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return _from_text(column, name, where)
    return None


def _from_text(column: Any, name: str, where: str) -> Any | None:
    import pyarrow as pa
    import pyarrow.compute as pc

    column = pc.utf8_trim_whitespace(column)
    column = pc.if_else(pc.equal(column, ""), pa.scalar(None, column.type), column)
    texts = column.drop_null()
    zone = next((z for z in (None, "UTC") if len(texts) and _cast(texts.slice(0, 1), z) is not None), "")
    if zone == "":
        return None
    dates = _cast(column, zone)
    if dates is None:
        first = str(texts[0])
        row, text = _first_other(column, zone)
        raise BadInput(
            f"data row {row + 1} of column {name!r} must be a date and time like the first, {first!r}, got {text!r}",
            where,
            "write all time stamps alike: dates with times, with a UTC offset in every row or in none, or seconds",
        )
    return dates.cast(pa.int64())


def _first_other(column: Any, zone: str | None) -> tuple[int, str]:
    """The row and the text of the first cell that is no date of this zone."""
    for row in range(len(column)):
        if _cast(column.slice(row, 1), zone) is None:
            return row, str(column[row])[:60]
    raise AssertionError("every cell is a date, and the column is none")


def _cast(column: Any, zone: str | None) -> Any | None:
    """A column as Arrow timestamps in ns; None where a cell is no date, or has a zone where others have none."""
    import pyarrow as pa

    try:
        return column.cast(pa.timestamp("ns", zone))
    except pa.ArrowInvalid:
        return None
