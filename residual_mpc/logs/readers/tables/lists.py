"""List columns of a Parquet table, as LeRobot writes them, one column of numbers for each of their elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LONGEST = 128  # elements; a longer list is a scan or an image, not joint values
SHOWN = 4  # names in a note


@dataclass(frozen=True)
class Element:
    """column: of lists. index: of the element in each. size: of the lists."""

    column: str
    index: int
    size: int


def find_elements(file: Any, info: Mapping[str, Any] | None) -> dict[str, dict[str, Element]]:
    """The list columns of numbers in an open Parquet file: column -> names of its elements -> element.

    The names are `column.name`, or `column.number` where the data set (`info`) does not name them.
    """
    found = {}
    for field in file.schema_arrow:
        size = _size(file, field)
        if 0 < size <= LONGEST:
            names = _names(info or {}, field.name, size)
            found[field.name] = {f"{field.name}.{n}": Element(field.name, i, size) for i, n in enumerate(names)}
    return found


def note_of(lists: Mapping[str, Mapping[str, Element]]) -> str:
    """How the list columns were split, as a sentence; empty if there are none."""
    parts = []
    for column, elements in lists.items():
        names = list(elements)
        shown = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
        parts.append(f"{column!r} as {shown} ({len(names)} elements)")
    return f"list columns are split into their elements: {'; '.join(parts)}" if parts else ""


def element_of(column: Any, element: Element) -> Any | str:
    """One element of an Arrow column of lists, as an Arrow column; or the reason why there is none, as a sentence."""
    import pyarrow.compute as pc

    sizes = pc.fill_null(pc.list_value_length(column), element.size).to_numpy()
    others = np.flatnonzero(sizes != element.size)
    if others.size:
        where = f"data row {others[0] + 1} of list column {element.column!r}"
        return f"{where} must have {element.size} elements like the first row, got {int(sizes[others[0]])}"
    return pc.list_element(column, element.index)


def _size(file: Any, field: Any) -> int:
    """How many numbers each list of a column holds, by its type or by its first list; 0 for any other column."""
    import pyarrow as pa

    kind = field.type
    fixed = pa.types.is_fixed_size_list(kind)
    if not fixed and not pa.types.is_list(kind) and not pa.types.is_large_list(kind):
        return 0
    value = kind.value_type
    if not (pa.types.is_integer(value) or pa.types.is_floating(value) or pa.types.is_boolean(value)):
        return 0
    if fixed:
        return int(kind.list_size)
    for batch in file.iter_batches(batch_size=64, columns=[field.name]):
        for cell in batch.column(field.name):
            if cell.is_valid:
                return len(cell)
    return 0


def _names(info: Mapping[str, Any], column: str, size: int) -> Sequence[str]:
    """The names of a list's elements, or their numbers where the data set has not exactly one for each."""
    features = info.get("features")
    feature = features.get(column) if isinstance(features, dict) else None
    names = _flat(feature.get("names") if isinstance(feature, dict) else None)
    usable = len(names) == size == len(set(names)) and all(isinstance(n, str) and n.strip() for n in names)
    return names if usable else [str(i) for i in range(size)]


def _flat(names: Any) -> list[Any]:
    """Names as data sets write them: a list, lists by kind (`{"motors": [...]}`), or places by name (`{"x": 0}`)."""
    if isinstance(names, list):
        return names
    if not isinstance(names, dict):
        return []
    if all(isinstance(place, int) for place in names.values()):
        return sorted(names, key=lambda name: int(names[name]))
    return [name for part in names.values() if isinstance(part, list) for name in part]
