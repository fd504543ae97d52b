"""From a column's cells to numbers, or to the first cell that is none."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.dates import EXAMPLE
from residual_mpc.logs.run import FloatArray

DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")
LARGEST = 1e9  # no quantity of the log format comes near; beyond it stand sentinels such as 3.4e38


def numbers(column: Any, name: str, where: str) -> FloatArray:
    """An Arrow column as (n,) floats, NaN where a cell is empty.

    Raises:
        BadInput: a cell that is no number, or is infinite, or beyond any quantity of the log format.
    """
    values = _cast(column)
    if values is None:
        row, text = _first_text(column)
        remedy = "leave the cell empty if the value is missing; use decimal points"
        if name == "t":
            remedy = f"write the time stamps as numbers in seconds, or as dates with times such as {EXAMPLE}"
        if DECIMAL_COMMA.fullmatch(text):
            remedy = "write decimal points instead of decimal commas"
        what = f"data row {row + 1} of column {name!r} must be a number, got {text!r}"
        raise BadInput(what, where, remedy)
    bad = np.flatnonzero(np.abs(values) > LARGEST * (1e12 if name == "t" else 1.0))
    if bad.size:
        what = f"data row {bad[0] + 1} of column {name!r} must be a finite quantity, got {values[bad[0]]:g}"
        raise BadInput(what, where, "leave the cell empty if the value is missing")
    return values


def numbers_or_none(column: Any) -> FloatArray | None:
    """An Arrow column as (n,) floats, or None where it holds anything else."""
    return _cast(column)


def whole_numbers(column: Any) -> NDArray[np.int64] | None:
    """An Arrow column of whole numbers as (n,), 0 where a cell is empty; None where it holds anything else."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not pa.types.is_integer(column.type):
        return None
    try:
        return np.array(pc.fill_null(column.cast(pa.int64()), 0).to_numpy(), dtype=np.int64)
    except pa.ArrowInvalid:  # beyond 63 bits
        return None


def labels(column: Any, name: str, where: str) -> list[str]:
    """An Arrow column as texts, whole numbers without a decimal point.

    Raises:
        BadInput: an empty cell.
    """
    texts = []
    for row, value in enumerate(column.to_pylist()):
        if value is None or value == "" or value != value:
            what = f"data row {row + 1} of column {name!r} is empty"
            raise BadInput(what, where, "name the run of every row")
        text = str(int(value)) if isinstance(value, float) and value.is_integer() else _text(value)
        texts.append(text.strip())
    return texts


def _cast(column: Any) -> FloatArray | None:
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = column.type
    if pa.types.is_dictionary(kind):
        column = column.cast(kind.value_type)
        kind = column.type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if pa.types.is_boolean(kind):
        column = column.cast(pa.int8())
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        column = pc.utf8_trim_whitespace(column)
        column = pc.if_else(pc.equal(column, ""), pa.scalar(None, kind), column)
    elif not (
        pa.types.is_boolean(kind)
        or pa.types.is_integer(kind)
        or pa.types.is_floating(kind)
        or pa.types.is_decimal(kind)
    ):
        return None
    try:
        values = column.cast(pa.float64(), safe=False).to_numpy()
    except pa.ArrowException:  # its "not implemented" is one of them
        return None
    return np.array(values, dtype=np.float64)  # a copy that can be written and does not keep the table alive


def _first_text(column: Any) -> tuple[int, str]:
    """The first cell that is no number."""
    for row, value in enumerate(column.to_pylist()):
        if value is None:
            continue
        try:
            float(_text(value))
        except (ValueError, OverflowError):
            return row, _text(value)[:60]
    return 0, str(column.type)


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
