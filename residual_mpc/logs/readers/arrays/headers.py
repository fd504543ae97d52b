"""An HDF5, MATLAB or NumPy file as the headers of tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.arrays.files import hdf5_entries, matlab_entries, npz_entries
from residual_mpc.logs.readers.arrays.tree import ArrayRun, Entry, Key, runs_of
from residual_mpc.logs.readers.table import Header, Remark, Table, first_line

SHOWN = 10  # names in a message
HDF5 = b"\x89HDF\r\n\x1a\n"
HDF5_AT = (0, 512)  # bytes; MATLAB writes a text of its own before


def array_headers(path: Path) -> tuple[Header, ...]:
    """A header for each run of a file. An (n,) array of a run is one column, an (n, k) array is k columns.

    Raises:
        BadInput: a damaged file, a file without numeric arrays, or a missing package.
    """
    with _readable(path):
        entries = _entries(path)
        runs = runs_of(entries)
    if not runs:
        listed = ", ".join("/".join(e.key) for e in entries[:SHOWN])
        what = f"no array of this file can be a column; it holds {listed or 'nothing that can be read'}"
        raise BadInput(what, str(path), "write `t` and one array of equal length for each column")
    return tuple(_header(path, run) for run in runs)


def _entries(path: Path) -> list[Entry]:
    with open(path, "rb") as file:
        start = file.read(max(HDF5_AT) + len(HDF5))
    if any(start[at : at + len(HDF5)] == HDF5 for at in HDF5_AT):
        return hdf5_entries(path)
    return npz_entries(path) if start.startswith(b"PK") else matlab_entries(path)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn any exception of a library that reads a file of unknown content into BadInput."""
    try:
        yield
    except BadInput:
        raise
    except Exception as fault:
        raise BadInput(f"the file is damaged ({first_line(fault)})", str(path), "export it again") from fault


def _header(path: Path, run: ArrayRun) -> Header:
    remarks = []
    if run.odd:
        shown = ", ".join(run.odd[:SHOWN]) + (", ..." if len(run.odd) > SHOWN else "")
        text = f"arrays whose length is not {run.rows}, or whose name repeats a column's, are ignored: {shown}"
        remarks.append(Remark("info", "other length", "", text))
    size = 8.0 * run.rows * len(run.parts)
    return Header(path, tuple(run.parts), size, partial(_read, path, run), run.label, remarks=tuple(remarks))


def _read(path: Path, run: ArrayRun, columns: Sequence[str]) -> Table:
    with _readable(path):
        found = _columns(run, columns)
    odd = next((name for name, column in found.items() if len(column) != run.rows), None)
    if odd is not None:
        raise BadInput(
            f"column {odd!r} must have {run.rows} values, got {len(found[odd])}", str(path), "export it again"
        )
    return Table(found)


def _columns(run: ArrayRun, names: Sequence[str]) -> dict[str, Any]:
    """The named columns as Arrow arrays. Each array of the file is loaded once, however many columns it has."""
    of_entry: dict[Key, list[str]] = {}
    for name in names:
        of_entry.setdefault(run.parts[name].entry.key, []).append(name)
    found = {}
    for group in of_entry.values():
        array = np.asarray(run.parts[group[0]].entry.load())
        found.update({name: _arrow(run.parts[name].values(array)) for name in group})
    return {name: found[name] for name in names}


def _arrow(values: np.ndarray) -> Any:
    import pyarrow as pa

    if values.dtype.kind in "iufb":
        native = values.astype(values.dtype.newbyteorder("="))
        return pa.array(native.astype(np.float64) if native.dtype.itemsize not in (1, 2, 4, 8) else native)
    return pa.array([v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in values.tolist()])
