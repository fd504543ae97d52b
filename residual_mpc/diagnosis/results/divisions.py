"""The windows in parts in which the size of an effect may differ: runs, and thirds of a motion, of an influence or of
positions."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.models.settings import Term

KINDS = ("by_run", "by_motion", "by_influence", "by_position")
LEVELS = ("small", "medium", "large")  # of the motion within a window
PLACES = ("low", "middle", "high")  # of a joint, over all windows
INFLUENCES = ("weak", "medium", "strong")  # of the effect on the prediction of a window


@dataclass(frozen=True, eq=False)
class Division:
    """kind: of KINDS; names: of its parts (P, W) bool; of: the quantity (W,) by which the windows are divided, NaN
    where it is not known, None for runs."""

    kind: str
    names: tuple[str, ...]
    parts: np.ndarray
    of: np.ndarray | None = None


def divisions_of(data: Dataset, scales: Scales, most: int) -> tuple[Division, ...]:
    """By run, unless there are too many of them, and by the size of the motion within a window, in thirds."""
    runs = np.unique(data.run)
    by_run = Division("by_run", tuple(data.runs[i].name for i in runs), data.run == runs[:, None])
    moved = (data.y - data.y[:, :1]) / scales.motion
    level = np.sqrt(np.nanmean(np.where(np.isfinite(moved), moved, 0.0) ** 2, axis=(1, 2)))
    by_motion = _thirds("by_motion", LEVELS, level)
    return (by_motion,) if len(runs) > most else (by_run, by_motion)


def divisions_of_effect(
    data: Dataset, term: Term, information: np.ndarray, slots: tuple[str, ...]
) -> tuple[Division, ...]:
    """By how much the effect changes the prediction of a window, and by where the joint that it acts on, or whose
    sensor it acts on, is in a window, in thirds; the latter not where it acts on no single joint whose position is
    logged. information (W,): of its size in each window; slots: the targets that the robot has for the effect."""
    by_influence = _thirds("by_influence", INFLUENCES, information)
    target = slots[0] if term.target is None and len(slots) == 1 else term.target
    names = (str(target), f"position.{target}")
    channel = next((c for c in names if c.startswith("position.") and c in data.channels), None)
    if channel is None:
        return (by_influence,)
    y = data.y[:, :, data.channels.index(channel)]
    seen = np.isfinite(y)
    place = np.where(seen, y, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    return by_influence, _thirds("by_position", PLACES, np.where(seen.any(axis=1), place, np.nan))


def _thirds(kind: str, names: tuple[str, ...], of: np.ndarray) -> Division:
    """The windows in thirds of a quantity (W,); where it is not known they join the middle third."""
    known = np.isfinite(of)
    ends = np.quantile(of[known], (1 / 3, 2 / 3)) if known.any() else np.zeros(2)
    third = np.where(known, np.searchsorted(ends, of), 1)
    return Division(kind, names, third == np.arange(len(names))[:, None], of)
