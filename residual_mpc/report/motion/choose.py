"""Which windows are worth a picture: where the gap is largest, where the named effects remove most of it, and where
both are one, a window like most."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.data.gap import per_window
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.report.motion.ghosts import block_of, measured_channels

GAP, CORRECTION, TYPICAL = "largest gap", "largest correction", "median gap"


def chosen_windows(made: DiagnosisResult) -> Mapping[int, tuple[str, ...]]:
    """Window -> what it shows. Held-out windows alone, where there are any, of which enough was measured to draw the
    robot; empty where there is none."""
    before, after = window_gaps(made)
    usable = np.isfinite(before) & np.array([_drawable(made, w) for w in range(made.data.count)])
    if not usable.any():
        return {}
    usable &= made.held if (usable & made.held).any() else True
    out: dict[int, tuple[str, ...]] = {}
    worst = int(np.argmax(np.where(usable, before, -np.inf)))
    out[worst] = (GAP,)
    if made.diagnosis.causes:
        removed = np.where(usable, before - after, -np.inf)
        best = int(np.argmax(removed))
        if removed[best] > 0.0:
            out[best] = (*out.get(best, ()), CORRECTION)
    if len(out) == 1:
        order = np.argsort(np.where(usable, before, np.inf))[: int(usable.sum())]
        out.setdefault(int(order[(len(order) - 1) // 2]), (TYPICAL,))
    return out


def best_window(made: DiagnosisResult) -> int | None:
    """Of all windows the one in which the named effects remove most of the gap, or with the largest gap where none is
    named; None where nothing can be drawn."""
    before, after = window_gaps(made)
    usable = np.isfinite(before) & np.array([_drawable(made, w) for w in range(made.data.count)])
    if not usable.any():
        return None
    return int(np.argmax(np.where(usable, before - after if made.diagnosis.causes else before, -np.inf)))


def window_gaps(made: DiagnosisResult) -> tuple[np.ndarray, np.ndarray]:
    """(W,) the windows' gaps before and after, unitless; NaN where nothing is compared."""
    before, after = (np.sqrt(per_window(made.data, made.scales, e)) for e in (made.before, made.after))
    return before, after


def _drawable(made: DiagnosisResult, window: int) -> bool:
    """Whether the window has a measured position: of a robot that drives, where it is."""
    seen = measured_channels(made.data, window)
    states = {s.position for s in block_of(made.data, window).robot.states}
    needed = {"pose.x", "pose.y"} & states
    return bool(seen) and needed <= set(seen)
