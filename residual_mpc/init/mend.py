"""Logs written anew, with the columns that no robot file can put right."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.init.guess import Mend
from residual_mpc.init.recording import dates_as_numbers
from residual_mpc.logs.cells import numbers_or_none
from residual_mpc.logs.find import find_tables, stem
from residual_mpc.logs.table import read_header, read_table


def write_mended(paths: Sequence[str | Path], mends: Sequence[Mend], folder: Path) -> tuple[Path, ...]:
    """The tables with their columns mended, as Parquet files of the same names; all else is kept.

    Raises BadInput where a file is there already, two tables have one name, or the folder cannot be written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    sources = find_tables(paths)
    targets = [folder / f"{stem(source)}.parquet" for source in sources]
    for target in targets:
        if target.exists():
            raise BadInput("there is such a file already", str(target), "name an empty folder with --mended")
        if targets.count(target) > 1:
            raise BadInput(f"two tables are called {target.stem}", str(folder), "rename one of them")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for source, target in zip(sources, targets, strict=True):
            header = read_header(source)
            columns = dict(read_table(header, header.names).columns)
            for mend in mends:
                if mend.column in columns:
                    old = columns[mend.column]
                    values = numbers_or_none(old)
                    values = dates_as_numbers(old, mend.column) if values is None else values
                    if values is not None:
                        columns[mend.column] = pa.array(mend.factor * values + mend.offset, from_pandas=True)
            pq.write_table(pa.table(columns), target)
    except OSError as fault:
        raise BadInput(f"it cannot be written ({fault.strerror})", str(folder), "choose another folder") from fault
    return tuple(targets)
