"""Logs written anew, with the columns that no robot file can put right."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.guess import LogCorrection
from residual_mpc.logs.readers.cells import numbers_or_none
from residual_mpc.logs.readers.find import find_tables, stem
from residual_mpc.logs.readers.headers import read_headers
from residual_mpc.logs.readers.table import Header

CORRECTED = b"residual_mpc.corrected"  # in the metadata of tables that are written here


def refuse_corrected(paths: Sequence[str | Path]) -> None:
    """Raises BadInput for a table that `write_corrected_logs` has written: its columns keep their names, of which some
    say degrees, and would be corrected once more."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for path in find_tables(paths):
        if path.suffix != ".parquet":
            continue
        try:
            metadata = pq.read_schema(path).metadata or {}
        except (OSError, pa.ArrowInvalid):
            continue  # the reader says what is wrong with it
        if CORRECTED in metadata:
            raise BadInput(
                "init has already corrected these runs",
                str(path),
                "pass the original runs to init; the robot file that it wrote with these copies already fits them",
            )


def write_corrected_logs(paths: Sequence[str | Path], mends: Sequence[LogCorrection], folder: Path) -> tuple[Path, ...]:
    """The tables with their columns mended, as Parquet files of the same names; all else is kept.

    Raises BadInput where a file is there already, two tables have one name, or the folder cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    sources = [header for path in find_tables(paths) for header in read_headers(path)]
    targets = [folder / f"{_file_stem(source)}.parquet" for source in sources]
    for target in targets:
        if target.exists():
            raise BadInput("this file already exists", str(target), "choose an empty folder with --mended")
        if targets.count(target) > 1:
            raise BadInput(f"two tables are named {target.stem}", str(folder), "rename one of them")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as scratch:  # all of them or none
            parts = [Path(scratch) / target.name for target in targets]
            for source, part in zip(sources, parts, strict=True):
                pq.write_table(pa.table(_mended(source, mends)).replace_schema_metadata({CORRECTED: b"yes"}), part)
            for part, target in zip(parts, targets, strict=True):
                part.replace(target)
    except OSError as fault:
        raise BadInput(f"cannot be written ({fault.strerror})", str(folder), "choose another folder") from fault
    return tuple(targets)


def _file_stem(header: Header) -> str:
    """Of the file that a run is written to; a file of several runs becomes several files."""
    label = header.label.replace("/", "_")
    return f"{stem(header.path)}_{label}" if label else stem(header.path)


def _mended(header: Header, mends: Sequence[LogCorrection]) -> dict[str, Any]:
    import pyarrow as pa

    columns = dict(header.read(header.names).columns)
    for mend in (m for m in mends if m.column in columns):
        values = numbers_or_none(columns[mend.column])
        if values is not None:
            columns[mend.column] = pa.array(mend.factor * values + mend.offset, from_pandas=True)
    return columns
