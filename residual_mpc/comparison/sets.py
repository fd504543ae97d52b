"""Two sets of runs cut into windows, and the stretches that are treated as independent observations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset, joined, window_starts
from residual_mpc.diagnosis.data.gap import Scales, measure_scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.data.outliers import Outliers, find_outliers
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.predict.horizons import free_starts, held_spans
from residual_mpc.diagnosis.predict.replay import predict, with_outliers_removed
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class TwoSets:
    """raw: all W windows of both sets; clean: the same without outliers; later (R,) bool: which runs belong to the
    later set; kept, held (W,) bool: the data held out from all fits; outliers: flagged in `raw`, velocities
    included."""

    raw: Dataset
    clean: Dataset
    scales: Scales
    later: np.ndarray
    kept: tuple[KeptBack, ...]
    held: np.ndarray
    outliers: Outliers

    @property
    def fitting(self) -> Dataset:
        """The windows that fits may see, without outliers."""
        return self.clean.take(~self.held)

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
    clean = with_outliers_removed(raw, found.flagged)
    missed = per_window(raw, scales, raw.y - predict(raw, Settings(1))[0])
    kept: list[KeptBack] = []
    for mine in (~later[raw.run], later[raw.run]):
        kept += choose_held_out(raw.take(mine), missed[mine], settings=settings)
    held = held_out_mask(raw, kept) if kept else np.zeros(raw.count, dtype=bool)
    return TwoSets(raw, clean, scales, later, tuple(kept), held, find_outliers(raw, settings=settings, velocities=True))


def windows(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    later: np.ndarray,
    horizon: float,
    settings: DataSettings,
    starts: Sequence[np.ndarray] | None = None,
) -> Dataset:
    """The windows of both sets, those before first, each set in separate blocks; starts: start times of each run's
    windows, s (None: those of the gap)."""
    begun = [window_starts(r, horizon) for r in runs] if starts is None else starts
    parts = []
    for name, mine in (("before", ~later), ("after", later)):
        here = [t if m else t[:0] for t, m in zip(begun, mine, strict=True)]
        try:
            part = build_dataset(runs, robots, noise, horizon, here, settings=settings)
        except BadInput as error:
            raise BadInput(f"{error.what} in the runs {name} the change", error.where, error.remedy) from error
        blocks = tuple(replace(b, later=name == "after") for b in part.blocks)
        parts.append(replace(part, blocks=blocks))
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
    free: bool = False,
) -> tuple[Dataset, Scales] | None:
    """Windows of another length, without outliers, and the size of their motion; free: only windows that do not overlap
    held-out data. None if one of the sets has no such windows."""
    runs = sets.raw.runs
    starts = [free_starts(r, held_spans(r, sets.kept), horizon) for r in runs] if free else None
    try:
        data = windows(runs, robots, noise, sets.later, horizon, settings, starts)
        data = with_outliers_removed(data, find_outliers(data, settings=settings).flagged)
        return data, measure_scales(data)
    except BadInput:  # a set has no window of that length, or nothing moves
        return None
