"""Recognise a file or recording, and read the headers of the tables in it."""

from __future__ import annotations

import os
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.formats import BAG, BAG2, ENOUGH, HDF5, MATLAB, MCAP, NPZ, recognise
from residual_mpc.logs.readers.table import Header


def read_headers(path: Path) -> tuple[Header, ...]:
    """The tables of a file or of a recording's folder: one, or one for each run if the format separates runs.

    Raises:
        BadInput: an empty, unreadable or damaged file, one of another format, a package that is not installed, or two
            columns of one name.
    """
    if path.is_dir():
        return _recording(path)
    try:
        with open(path, "rb") as file:
            start = file.read(ENOUGH)
        size = os.stat(path).st_size
    except OSError as fault:
        raise BadInput(f"cannot be read ({fault.strerror or fault})", str(path)) from fault
    if not start:
        raise BadInput("must be a table with a header, got an empty file", str(path))
    found = recognise(start, path.name)
    if found in (MCAP, BAG, BAG2):
        return _recording(path)
    if found in (HDF5, MATLAB, NPZ):
        from residual_mpc.logs.readers.arrays.headers import array_headers

        return array_headers(path)
    if found is not None:
        raise found.refusal(path)
    return (_table(path, start, size),)


def _table(path: Path, start: bytes, size: int) -> Header:
    if start.startswith(b"PAR1"):
        from residual_mpc.logs.readers.tables.parquet import parquet_header

        return parquet_header(path)
    if path.suffix.lower() == ".parquet":
        raise BadInput("must be a Parquet file, got another format", str(path), "export it again as Parquet or CSV")
    from residual_mpc.logs.readers.tables.text import text_header

    try:
        return text_header(path, size, zipped=start[:2] == b"\x1f\x8b")
    except OSError as fault:
        raise BadInput(f"cannot be read ({fault.strerror or fault})", str(path)) from fault


def _recording(path: Path) -> tuple[Header, ...]:
    from residual_mpc.logs.readers.recordings.headers import recording_header

    return (recording_header(path),)
