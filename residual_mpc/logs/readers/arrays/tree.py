"""Named arrays, in folders or groups, as columns of runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.logs.columns import likely_time

LONGEST = 128  # columns of a matrix; a wider one is an image or a scan

Key = tuple[str, ...]  # the groups of an array, and its own name
Load = Callable[[], Any]  # the values of an array


@dataclass(frozen=True)
class Entry:
    """One array of a file.

    Attributes:
        key: where it is.
        shape: (n,), or (n, k) or (k, n) for k quantities.
        load: its values.
        names: of the quantities of a matrix, empty where the file does not name them.
        text: whether it holds strings.
    """

    key: Key
    shape: tuple[int, ...]
    load: Load
    names: tuple[str, ...] = ()
    text: bool = False


@dataclass(frozen=True)
class Part:
    """A column: a whole array, or one quantity of a matrix."""

    entry: Entry
    axis: int  # along which the samples lie
    index: int | None  # of the quantity in a matrix

    def values(self, array: np.ndarray) -> np.ndarray:
        """(n,) the column's cells, from the loaded array of its entry."""
        if self.index is None:
            return array.reshape(-1)
        return array[:, self.index] if self.axis == 0 else array[self.index]


@dataclass(frozen=True)
class ArrayRun:
    """Attributes:
    label: name of the group that is the run; empty if the file is one run.
    rows: number of samples.
    parts: column -> its part.
    odd: arrays that are not columns: of another length, or with the name of an earlier column.
    """

    label: str
    rows: int
    parts: Mapping[str, Part]
    odd: tuple[str, ...]


def runs_of(entries: Sequence[Entry]) -> list[ArrayRun]:
    """The runs of a file: each group that contains a time array, with everything below it; else the whole file."""
    usable = [e for e in entries if _samples(e) > 1]
    groups = _groups_with_time(usable, ())
    runs = [_run(group, [e for e in usable if e.key[: len(group)] == group]) for group in groups or [()]]
    return [run for run in runs if run.parts]


def _groups_with_time(entries: Sequence[Entry], group: Key) -> list[Key]:
    """The outermost groups that contain an array with the name of a time."""
    depth = len(group)
    direct = [e.key[depth] for e in entries if len(e.key) == depth + 1]
    if likely_time(direct) is not None:
        return [group]
    below = dict.fromkeys(e.key[depth] for e in entries if len(e.key) > depth + 1)
    return [
        found
        for name in below
        for found in _groups_with_time([e for e in entries if e.key[depth] == name], (*group, name))
    ]


def _run(group: Key, entries: Sequence[Entry]) -> ArrayRun:
    named = {e.key[-1]: e for e in entries if len(e.key) == len(group) + 1}
    time = likely_time(named)
    lengths = Counter(n for e in entries for n in _lengths(e))
    rows = _samples(named[time]) if time is not None else lengths.most_common(1)[0][0] if lengths else 0
    parts: dict[str, Part] = {}
    odd = []
    for entry in entries:
        name = ".".join(entry.key[len(group) :])
        columns = _parts(entry, name, rows)
        if columns and not parts.keys() & columns.keys():
            parts.update(columns)
        else:
            odd.append(name)
    return ArrayRun("/".join(group), rows, parts, tuple(odd))


def _parts(entry: Entry, name: str, rows: int) -> dict[str, Part]:
    """The columns of an array; none if no axis has the length of the run."""
    shape = entry.shape
    if rows not in _lengths(entry):
        return {}
    if len(shape) == 1 or 1 in shape:
        return {name: Part(entry, 0, None)}
    axis = 0 if shape[0] == rows else 1
    count = shape[1 - axis]
    names = entry.names if len(set(entry.names)) == count else tuple(str(i) for i in range(count))
    return {f"{name}.{each}": Part(entry, axis, i) for i, each in enumerate(names)}


def _samples(entry: Entry) -> int:
    """The largest number of samples that an array may hold; 0 if it cannot be a column."""
    return max(_lengths(entry), default=0)


def _lengths(entry: Entry) -> tuple[int, ...]:
    """The lengths of the axes of an array along which its samples may lie."""
    shape = entry.shape
    if len(shape) == 1:
        return shape
    if len(shape) != 2:
        return ()
    if 1 in shape:
        return (max(shape),)
    if entry.text:
        return ()
    return tuple(n for n, other in (shape, shape[::-1]) if other <= LONGEST)
