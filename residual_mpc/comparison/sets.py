"""Two sets of runs cut into windows, and the stretches that are treated as independent observations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset, joined, window_starts
from residual_mpc.diagnosis.data.gap import Scales, measure_scales
from residual_mpc.diagnosis.data.left_out import unfit, without
from residual_mpc.diagnosis.data.outliers import Outliers, find_outliers, with_outliers_removed
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.stale import with_stale
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot


@dataclass(frozen=True, eq=False)
class TwoSets:
    """raw: all W windows of both sets; clean: the same without outliers and stale readings; later (R,) bool: which runs
    belong to the later set; outliers: flagged in `raw`, velocities included."""

    raw: Dataset
    clean: Dataset
    scales: Scales
    later: np.ndarray
    outliers: Outliers

    def side(self, data: Dataset) -> np.ndarray:
        """(W,) bool: which windows of `data` belong to the later set."""
        return np.asarray(self.later[data.run])


def cut(
    before: Sequence[Run],
    after: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    horizon: float,
    settings: DataSettings,
) -> TwoSets:
    """robots: the nominal model of each run, those before first.

    Raises BadInput if one of the sets has nothing to compare.
    """
    runs = (*before, *after)
    later = np.array([False] * len(before) + [True] * len(after))
    raw = windows(runs, robots, noise, later, horizon, settings)
    scales = measure_scales(raw)
    found = find_outliers(raw, settings=settings)
    clean = with_outliers_removed(raw, with_stale(raw, found.flagged))
    return TwoSets(raw, clean, scales, later, find_outliers(raw, settings=settings, velocities=True))


def windows(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    later: np.ndarray,
    horizon: float,
    settings: DataSettings,
) -> Dataset:
    """The windows of both sets, those before first, each set in separate blocks; none across a gap or an incident of
    the log."""
    begun = [window_starts(r, horizon) for r in runs]
    parts = []
    for name, mine in (("before", ~later), ("after", later)):
        here = [t if m else t[:0] for t, m in zip(begun, mine, strict=True)]
        try:
            part = build_dataset(runs, robots, noise, horizon, here, settings=settings)
        except BadInput as error:
            raise BadInput(f"{error.what} in the runs {name} the change", error.where, error.remedy) from error
        blocks = tuple(replace(b, group=int(name == "after")) for b in part.blocks)
        part = replace(part, blocks=blocks)
        parts.append(without(part, unfit(part)))
    return joined(parts)


def units_of(data: Dataset, later: np.ndarray, settings: ContrastSettings) -> np.ndarray:
    """(W,) number of each window's unit: its run or, if the set has few runs, a stretch of it; later (R,) bool."""
    number = np.zeros(data.count, dtype=int)
    at = 0
    for side in (False, True):
        mine = later[data.run] == side
        runs = np.unique(data.run[mine])
        pieces = int(np.ceil(settings.units / max(len(runs), 1)))
        for i in runs:
            here = np.flatnonzero(mine & (data.run == i))
            here = here[np.argsort(data.start[here], kind="stable")]
            span = float(np.ptp(data.start[here])) + data.horizon
            n = int(np.clip(span / max(settings.unit, data.horizon), 1, pieces))
            number[here] = at + np.clip((data.start[here] - data.start[here[0]]) * n / span, 0, n - 1).astype(int)
            at += n
    return number


def windows_of(
    sets: TwoSets,
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    horizon: float,
    settings: DataSettings,
) -> tuple[Dataset, Scales] | None:
    """Windows of another length, without outliers, and the size of their motion. None if one of the sets has no such
    windows."""
    try:
        data = windows(sets.raw.runs, robots, noise, sets.later, horizon, settings)
        data = with_outliers_removed(data, with_stale(data, find_outliers(data, settings=settings).flagged))
        return data, measure_scales(data)
    except BadInput:  # a set has no window of that length, or nothing moves
        return None
