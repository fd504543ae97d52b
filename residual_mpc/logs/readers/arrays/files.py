"""The arrays of a file, listed without reading them where the format allows it."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.extras import extra
from residual_mpc.logs.readers.arrays.mat_structure import sound_variables
from residual_mpc.logs.readers.arrays.tree import Entry, Key, Load

NAMES = (
    "names",
    "columns",
    "fields",
    "joint_names",
    "feature_names",
    "name",
)  # attributes that name a matrix's columns
MATLAB_LIMIT = 1 << 30  # bytes; scipy reads the whole of a MATLAB file, compressed or not
INTERNAL = "#"  # how MATLAB's own groups in an HDF5 file begin


def npz_entries(path: Path) -> list[Entry]:
    """The arrays of a NumPy archive, from their headers."""
    entries = []
    with zipfile.ZipFile(path) as archive:
        for member in archive.namelist():
            if not member.endswith(".npy"):
                continue
            with archive.open(member) as file:
                version = np.lib.format.read_magic(file)
                read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, kind = read(file)
            name = member.removesuffix(".npy")
            key = tuple(name.split("/"))
            entries += _entries_of(key, shape, kind, partial(_load_npz, path, name))
    return entries


def _load_npz(path: Path, name: str) -> Any:
    with np.load(path, allow_pickle=False) as archive:
        return archive[name]


def hdf5_entries(path: Path) -> list[Entry]:
    """The data sets of an HDF5 file, MATLAB's of version 7.3 included."""
    with extra("hdf5"):
        import h5py
    entries: list[Entry] = []
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset) or name.startswith(INTERNAL) or item.shape is None:
                return
            names = _names_of(item)
            entries.extend(
                _entries_of(tuple(name.split("/")), item.shape, item.dtype, partial(_load_hdf5, path, name), names)
            )

        file.visititems(visit)
    return entries


def _load_hdf5(path: Path, name: str) -> Any:
    import h5py

    with h5py.File(path, "r") as file:
        return file[name][()]


def _names_of(item: Any) -> tuple[str, ...]:
    for attribute in NAMES:
        if attribute in item.attrs:
            value = np.asarray(item.attrs[attribute]).reshape(-1).tolist()
            return tuple(v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in value)
    return ()


def matlab_entries(path: Path) -> list[Entry]:
    """The variables of a MATLAB file before version 7.3; the fields of a structure are named after it."""
    from scipy.io import loadmat

    if path.stat().st_size > MATLAB_LIMIT:
        what = f"a MATLAB file must be smaller than {MATLAB_LIMIT >> 30} GiB"
        raise BadInput(what, str(path), "save it with the option -v7.3")
    names = sound_variables(path)
    if not names:
        remedy = "in MATLAB: save plain arrays instead of tables or time series, or writetable(..., 'run.csv')"
        raise BadInput("this MATLAB file holds no arrays or structures that can be read", str(path), remedy)
    variables = loadmat(path, simplify_cells=True, variable_names=names)
    found = [pair for name, value in variables.items() if not name.startswith("__") for pair in _leaves((name,), value)]
    return [e for key, array in found for e in _entries_of(key, array.shape, array.dtype, partial(_same, array))]


def _leaves(key: Key, value: Any) -> Iterator[tuple[Key, Any]]:
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _leaves((*key, str(name)), part)
    elif isinstance(value, list) or isinstance(value, np.ndarray) and value.dtype.kind == "O":
        parts = list(value)
        if parts and all(isinstance(part, str) for part in parts):
            yield key, np.array(parts)
        elif parts and all(isinstance(part, dict) for part in parts):  # an array of structures: one run each
            for i, part in enumerate(parts):
                yield from _leaves((*key, str(i + 1)), part)
    elif isinstance(value, np.ndarray):
        yield key, value


def _same(array: np.ndarray) -> np.ndarray:
    return array


def _entries_of(
    key: Key, shape: Sequence[int], kind: np.dtype[Any], load: Load, names: tuple[str, ...] = ()
) -> list[Entry]:
    """One entry for an array, one for each field of a structured array, none for other contents."""
    shape = tuple(int(n) for n in shape)
    if kind.names:
        return [
            entry
            for field in kind.names
            for entry in _entries_of((*key, field), shape, kind[field], partial(_field, load, field))
            if not kind[field].shape
        ]
    if kind.kind in "iufb":
        return [Entry(key, shape, load, names)]
    return [Entry(key, shape, load, names, text=True)] if kind.kind in "SUO" and len(shape) == 1 else []


def _field(load: Load, name: str) -> Any:
    return load()[name]
