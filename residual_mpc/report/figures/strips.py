"""Runs as strips along time, one rectangle a window, darker where the gap is larger."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from residual_mpc.report.evidence.evidence import Array, Windows

PIECES = 160  # of a strip; more windows than this are pooled


@dataclass(frozen=True)
class Piece:
    """One window, or several that were pooled."""

    x: float  # s from the run's start
    width: float  # s
    level: float | None  # depth of colour, 0 to 1; None where all its windows were skipped
    held_out: bool


@dataclass(frozen=True)
class Strip:
    """One run."""

    run: str
    length: float  # s
    gap: float  # 1, root of the mean square over the windows that count
    worst: float  # s from the run's start: where the window with the largest gap begins
    pieces: tuple[Piece, ...]
    marks: tuple[tuple[float, float], ...]  # (x, width) in s: the moments that the document names


def strips(
    windows: Windows,
    held_out: NDArray[np.bool_],
    horizon: float,
    dark: float,
    times: Sequence[Any],
    first: Callable[[str], float],
) -> list[Strip]:
    """The runs, the one with the largest gap first. dark: the gap that gets the full colour; first: the first stamp of
    a run, s."""
    names = np.asarray(windows.run, dtype=str)
    made = []
    for run in dict.fromkeys(windows.run):
        mine = names == run
        start, before = windows.start[mine], windows.before[mine]
        start = start - first(run)
        made.append(
            Strip(
                run=run,
                length=float(start[-1]) + horizon,
                gap=root_mean_square(before),
                worst=float(start[np.argmax(np.nan_to_num(before, nan=-1.0))]),
                pieces=_pieces(start, before / dark, held_out[mine], horizon),
                marks=tuple((t["from"] - first(run), t["to"] - t["from"]) for t in times if t["run"] == run),
            )
        )
    return sorted(made, key=lambda strip: -strip.gap)


def root_mean_square(gaps: Array) -> float:
    """Over what is not NaN; 0 where nothing is left."""
    seen = gaps[np.isfinite(gaps)]
    return float(np.sqrt(np.mean(seen**2))) if seen.size else 0.0


def _pieces(start: Array, level: Array, held_out: NDArray[np.bool_], horizon: float) -> tuple[Piece, ...]:
    pool = max(1, -(-start.size // PIECES))
    return tuple(
        Piece(
            x=float(start[part][0]),
            width=float(start[part][-1] - start[part][0]) + horizon,
            level=min(1.0, root_mean_square(level[part])) if np.isfinite(level[part]).any() else None,
            held_out=bool(held_out[part].any()),
        )
        for part in (slice(first, first + pool) for first in range(0, start.size, pool))
    )
