"""Which tables a user means by files, folders and glob patterns."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.formats import recognise_file
from residual_mpc.logs.readers.lists import DATA_SET

SUFFIXES = (".parquet", ".csv", ".csv.gz", ".tsv")
MANY = 50  # files of a folder that are looked into to say what it holds


def find_tables(paths: Sequence[str | Path]) -> tuple[Path, ...]:
    """The files behind paths, each once, in the order given; a folder stands for its tables by name.

    Raises:
        BadInput: no path at all, a missing file, a pattern without a match, a folder without tables.
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
    """The file's name without its suffixes (`a.csv.gz` -> `a`)."""
    for suffix in sorted(SUFFIXES, key=len, reverse=True):
        if path.name.lower().endswith(suffix) and len(path.name) > len(suffix):
            return path.name[: -len(suffix)]
    return path.stem


def _expand(text: str) -> list[Path]:
    path = Path(text)
    try:
        if path.is_dir():
            return _tables_of(path)
        if path.exists():
            return [path]
    except (OSError, ValueError) as fault:
        raise BadInput(f"cannot be accessed ({fault})", text[:200]) from fault
    if glob.has_magic(text):
        matches = sorted(Path(m) for m in glob.glob(text, recursive=True))
        files = [m for m in matches if m.is_file()]
        if not files:
            raise BadInput("no file matches this pattern", text, "check the folder and the file suffix")
        return files
    raise BadInput("file not found", text, "give CSV or Parquet files, or a folder of them")


def _tables_of(folder: Path) -> list[Path]:
    try:
        inside = [f for f in sorted(folder.iterdir()) if f.is_file() and not f.name.startswith(".")]
    except OSError as fault:
        raise BadInput(f"the folder cannot be read ({fault.strerror})", str(folder)) from fault
    files = [f for f in inside if f.name.lower().endswith(SUFFIXES)]
    if not files:
        raise _no_table(folder, inside)
    return files


def _no_table(folder: Path, inside: Sequence[Path]) -> BadInput:
    """A folder without tables, and what it holds instead."""
    if (folder / DATA_SET).is_file():
        tables = folder / "data" / "chunk-*" / "*.parquet"
        return BadInput("this is a LeRobot data set, not a run", str(folder), f"give its tables: '{tables}'")
    for file in inside[:MANY]:
        other = recognise_file(file)
        if other is not None:
            return BadInput(f"this folder contains no tables; {file.name} is {other.name}", str(folder), other.remedy)
    return BadInput("this folder contains no tables", str(folder), f"runs are files ending in {', '.join(SUFFIXES)}")
