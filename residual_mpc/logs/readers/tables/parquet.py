"""A Parquet file, of which only the columns that are needed are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.logs.readers.table import Header, Table, first_line
from residual_mpc.logs.readers.tables.lerobot import data_set_info, meanings_of, preferred_of
from residual_mpc.logs.readers.tables.lists import Element, element_of, find_elements, note_of

UNNAMED_INDEX = "__index_level_"  # what pandas calls an index without a name: row numbers, no measurement


def parquet_header(path: Path) -> Header:
    """The columns of a Parquet file.

    Raises:
        BadInput: a damaged file, or two columns of one name.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    info = data_set_info(path)
    try:
        with pq.ParquetFile(path) as file:
            lists = find_elements(file, info)
            own = [c for c in file.schema_arrow.names if not str(c).startswith(UNNAMED_INDEX)]
            names = tuple(n for column in own for n in lists.get(column, (str(column),)))
            rows = file.metadata.num_rows
    except (pa.ArrowException, OSError, ValueError) as fault:
        raise _damaged(path, fault) from fault
    elements = {name: element for column in lists.values() for name, element in column.items()}
    meanings = meanings_of(names) if info is not None else {}
    return Header(
        path,
        names,
        8.0 * rows * len(names),
        partial(_read, path, elements),
        note=note_of(lists),
        meanings=meanings,
        preferred=preferred_of(meanings),
    )


def _read(path: Path, elements: Mapping[str, Element], columns: Sequence[str]) -> Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:  # a dataset would invent columns from folder names
            # images and the like, which may be large
            nested = {f.name: f.type for f in file.schema_arrow if pa.types.is_nested(f.type) and f.name in columns}
            needed = {elements[name].column if name in elements else name for name in columns} - set(nested)
            table = file.read(columns=sorted(needed), use_pandas_metadata=False)
    except (pa.ArrowException, OSError, ValueError) as fault:
        raise _damaged(path, fault) from fault
    found, faults = {}, {}
    for name in columns:
        if name in nested:
            faults[name] = f"column {name!r} must hold numbers, got {nested[name]}"
            continue
        element = elements.get(name)
        column = table.column(name) if element is None else element_of(table.column(element.column), element)
        if isinstance(column, str):
            faults[name] = column
        else:
            found[name] = column
    return Table(found, (), faults)


def _damaged(path: Path, fault: Exception) -> BadInput:
    return BadInput(f"the Parquet file is damaged ({first_line(fault)})", str(path), "export it again")
