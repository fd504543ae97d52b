"""Find the runs that files, folders and glob patterns stand for."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.formats import recognise_file
from residual_mpc.logs.readers.tables.lerobot import data_set_tables, is_data_set

TABLES = (".parquet", ".csv", ".csv.gz", ".tsv")
RECORDINGS = (".mcap", ".db3", ".bag")
ARRAYS = (".h5", ".hdf5", ".npz", ".mat")
SUFFIXES = TABLES + RECORDINGS + ARRAYS
TEXT = ".txt"  # a table if it is given by name; in a folder it may be notes
BAG = "metadata.yaml"  # in the folder of a rosbag2
BAG_MARK = b"rosbag2_bagfile_information"  # in that file
MANY = 50  # files of a folder that are examined for an error message


def find_tables(paths: Sequence[str | Path]) -> tuple[Path, ...]:
    """The files and recordings behind paths, each once, in the order given; a folder stands for what it holds.

    The folder of a rosbag2 is one recording, and stands for itself; a LeRobot data set stands for its tables. Any other
    folder stands for its tables; if it has none, for the recordings in it and in the folders below it; if there are
    none, for its HDF5, NumPy and MATLAB files.

    Raises:
        BadInput: no path at all, a missing file, a pattern without a match, a folder without runs.
    """
    if isinstance(paths, str | Path):
        paths = [paths]
    if not paths:
        raise BadInput("at least one run is needed, got none", remedy="give files or a folder")
    found: dict[Path, Path] = {}
    for path in paths:
        for file in _expand(str(path)):
            found.setdefault(file.resolve(), file)
    return tuple(found.values())


def stem(path: Path) -> str:
    """The file's name without its suffixes (`a.csv.gz` -> `a`); a folder's whole name."""
    if path.is_dir():
        return path.resolve().name
    for suffix in sorted(SUFFIXES, key=len, reverse=True):
        if path.name.lower().endswith(suffix) and len(path.name) > len(suffix):
            return path.name[: -len(suffix)]
    return path.stem


def _expand(text: str) -> list[Path]:
    path = Path(text)
    try:
        if path.is_dir():
            return _runs_of(path)
        if path.exists():
            return [path]
    except (OSError, ValueError) as fault:
        raise BadInput(f"cannot be accessed ({fault})", text[:200]) from fault
    if glob.has_magic(text):
        matches = sorted(Path(m) for m in glob.glob(text, recursive=True))
        bags = {m for m in matches if m.is_dir() and _is_bag(m)}
        files = [m for m in matches if m in bags or m.is_file() and not bags & set(m.parents)]
        files += [t for m in matches if m.is_dir() and is_data_set(m) for t in data_set_tables(m)]
        if not files:
            raise BadInput("no file matches this pattern", text, "check the folder and the file suffix")
        return files
    raise BadInput("file not found", text, "give run files, or a folder of them")


def _is_bag(folder: Path) -> bool:
    try:
        with open(folder / BAG, "rb") as file:
            return BAG_MARK in file.read(4096)
    except OSError:
        return False


def _runs_of(folder: Path) -> list[Path]:
    if _is_bag(folder):
        return [folder]
    if is_data_set(folder):
        tables = data_set_tables(folder)
        if not tables:
            raise BadInput("this LeRobot data set has no tables", str(folder), "its runs lie in data/chunk-*/*.parquet")
        return tables
    try:
        inside = [f for f in sorted(folder.iterdir()) if f.is_file() and not f.name.startswith(".")]
    except OSError as fault:
        raise BadInput(f"the folder cannot be read ({fault.strerror})", str(folder)) from fault
    tables = [f for f in inside if f.name.lower().endswith(TABLES)]
    recordings = [f for f in inside if f.name.lower().endswith(RECORDINGS)]
    files = tables or recordings + _recordings_below(folder) or [f for f in inside if f.name.lower().endswith(ARRAYS)]
    if not files:
        raise _no_run(folder, inside)
    return files


def _recordings_below(folder: Path) -> list[Path]:
    """The bags, single recordings and data sets' tables in the folders below, by name. A bag without metadata, as an
    interrupted recording leaves it, is read file by file."""
    found: list[Path] = []
    for where, folders, files in os.walk(folder):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        if Path(where) != folder:
            found += [Path(where) / f for f in sorted(files) if f.lower().endswith(RECORDINGS)]
        for name in list(folders):
            below = Path(where) / name
            if _is_bag(below) or is_data_set(below):
                folders.remove(name)
                found += [below] if _is_bag(below) else data_set_tables(below)
    return found


def _no_run(folder: Path, inside: Sequence[Path]) -> BadInput:
    """A folder without runs, and what it holds instead."""
    for file in inside[:MANY]:
        other = recognise_file(file)
        if other is not None and other.remedy:
            return BadInput(f"this folder contains no runs; {file.name} is {other.name}", str(folder), other.remedy)
    deeper = _table_below(folder)
    if deeper is not None:
        return BadInput(
            f"this folder contains no runs itself; {deeper.relative_to(folder)} lies below it", str(folder),
            f"give {deeper.parent}, or a pattern such as '{folder}/**/*{deeper.suffix}': tables are not looked for in "
            "folders below",
        )  # fmt: skip
    text = next((file for file in inside if file.suffix.lower() == TEXT), None)
    if text is not None:
        remedy = f"give text tables by name, or by a pattern such as '{folder}/*{text.suffix}'"
        return BadInput(f"this folder contains no runs; {text.name} may be a table", str(folder), remedy)
    return BadInput("this folder contains no runs", str(folder), f"runs are files ending in {', '.join(SUFFIXES)}")


def _table_below(folder: Path) -> Path | None:
    """The first table in the folders below, by name; None where the first MANY of them have none."""
    for k, (where, folders, files) in enumerate(os.walk(folder)):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        tables = sorted(f for f in files if f.lower().endswith(TABLES))
        if tables:
            return Path(where) / tables[0]
        if k >= MANY:
            break
    return None
