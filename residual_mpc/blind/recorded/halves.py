"""The runs of one robot, parted at random into two halves that cover the motions alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run

SPLITS = 400  # drawn, of which the most even one is taken
SHORTEST_BLOCK = 4.0  # s: windows of a second need some room
MOST_BLOCKS = 16


def halves(runs: Sequence[Run], rng: np.random.Generator) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """(before, after). Words of the runs' names and how fast the robot moves are shared out as evenly as possible.

    A single run is cut into blocks of time first. Raises `BadInput` for fewer than two runs or blocks a half.
    """
    runs = blocks(runs[0]) if len(runs) == 1 else tuple(runs)
    if len(runs) < 4:
        raise BadInput(
            f"the runs cannot be parted into two halves: at least 4 runs are needed, or one run of "
            f"{4 * SHORTEST_BLOCK:g} s, got {len(runs)} run{'s' if len(runs) != 1 else ''}",
            "--from",
            "give more runs",
        )
    marks = _marks(runs)
    best, least = None, np.inf
    for _ in range(SPLITS):
        chosen = np.zeros(len(runs), dtype=bool)
        chosen[rng.permutation(len(runs))[: len(runs) // 2]] = True
        uneven = float(np.sum((marks[chosen].sum(axis=0) - marks[~chosen].sum(axis=0)) ** 2))
        if uneven < least:
            best, least = chosen, uneven
    assert best is not None
    return tuple(r for r, c in zip(runs, best, strict=True) if not c), tuple(
        r for r, c in zip(runs, best, strict=True) if c
    )


def blocks(run: Run) -> tuple[Run, ...]:
    """A run cut into an even number of blocks of equal length; the run itself where it is too short."""
    seconds = float(run.t[-1] - run.t[0])
    count = min(int(seconds / SHORTEST_BLOCK), MOST_BLOCKS) // 2 * 2
    if count < 4:
        return (run,)
    edges = np.searchsorted(run.t, run.t[0] + seconds * np.arange(count + 1) / count)
    edges[-1] = len(run.t)
    return tuple(_cut(run, slice(low, high), f"{run.name}_{i + 1:02d}") for i, (low, high) in enumerate(_pairs(edges)))


def _pairs(edges: np.ndarray) -> list[tuple[int, int]]:
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))


def _cut(run: Run, rows: slice, name: str) -> Run:
    t = run.t[rows]
    columns = {c: values[rows] for c, values in run.columns.items()}
    return replace(run, name=name, t=t - t[0], columns=columns, extra=(), extra_columns={}, start=run.start + t[0])


def _marks(runs: Sequence[Run]) -> np.ndarray:
    """(runs, marks) 0 or 1: words of the names, and whether a channel moves faster than in the median run."""
    words = sorted({w for run in runs for w in run.name.replace("/", "_").split("_")})
    named = [[float(w in run.name.replace("/", "_").split("_")) for w in words] for run in runs]
    shared = sorted(set.intersection(*(set(run.measured) for run in runs)))
    speed = np.array([[_roughness(run, c) for c in shared] for run in runs]).reshape(len(runs), -1)
    return np.hstack([np.array(named), (speed > np.median(speed, axis=0)).astype(float)])


def _roughness(run: Run, column: str) -> float:
    return float(np.nanstd(run.columns[column]))
