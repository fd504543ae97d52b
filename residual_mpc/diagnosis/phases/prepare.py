"""The first phase: the runs cut into windows, what is held out of them, and the hypotheses."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales, measure_scales, per_window, still_channels
from residual_mpc.diagnosis.data.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.data.left_out import unfit, untold, without, without_unfit
from residual_mpc.diagnosis.data.outliers import Outliers, find_outliers, with_outliers_removed
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.stale import with_stale
from residual_mpc.diagnosis.data.subsampling import evenly, thin_whole
from residual_mpc.diagnosis.data.unknown_past import after_unknown_past, runs_with_unknown_past
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.horizons import (
    HorizonWindows,
    foretold,
    longer_horizons,
    windows_between,
    windows_over,
)
from residual_mpc.diagnosis.predict.longer_steps import quickened
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class DiagnosisInput:
    """robots[i] is the nominal model of runs[i]; noise: the 1-sigma of a channel that the user states, channel unit;
    tunable: names, with wildcards, of the nominal parameters that every hypothesis refits."""

    runs: tuple[Run, ...]
    robots: tuple[Robot, ...]
    noise: Mapping[str, float]
    tunable: tuple[str, ...]
    options: Options


@dataclass(frozen=True, eq=False)
class Prepared:
    """raw: W windows as they were logged, all that are held out and of the others no more than fits need, none across a
    gap in the log; clean: less the samples that jump away or are stale. kept, held (W,) bool: what no fit may see;
    longer: the same runs over the longer horizons that the nominal model can predict; near: shorter windows that fits
    may see, with their scales, if the model can predict the headline's horizon but no longer one. Errors then grow so
    fast that a few diverging windows of the headline's horizon would dominate the fit. free (W,) bool: the windows that
    fits may see: neither held out nor at the beginning of a run whose past is unknown."""

    raw: Dataset
    clean: Dataset
    scales: Scales
    outliers: Outliers
    kept: tuple[KeptBack, ...]
    held: np.ndarray
    free: np.ndarray
    space: Space
    longer: tuple[HorizonWindows, ...]
    near: tuple[Dataset, Scales] | None
    options: Options

    @property
    def headline(self) -> tuple[Dataset, Scales]:
        """The windows that the first search fits, with their scales: of the headline's horizon, or shorter if errors
        grow too fast."""
        return self.near or (self.fitting, self.scales)

    @property
    def fitting(self) -> Dataset:
        """The windows that fits may see, without outliers."""
        return self.clean.take(self.free)


def prepare(given: DiagnosisInput, rng: np.random.Generator, progress: Progress) -> Prepared:
    """Raises BadInput where nothing can be compared."""
    progress("splitting the runs into windows", 0.005)
    runs, robots, noise, options = given.runs, given.robots, given.noise, given.options
    settings = options.settings
    raw = build_dataset(runs, robots, noise, options.horizon, settings=settings.data)
    scales = measure_scales(raw)
    outliers = find_outliers(raw, settings=settings.data)
    logged, raw = raw, without(raw, untold(raw))
    spoilt = with_stale(raw, outliers.flagged)
    clean = with_outliers_removed(raw, spoilt)
    kept, most = options.held_out, options.phases.most_steps
    if kept is None:
        quick = quickened(raw, scales, settings=settings.predict) if raw.cost > most else raw
        missed = per_window(raw, scales, raw.y - predict(quick, Settings(1))[0])
        kept = choose_held_out(raw, missed, settings=settings.data)
    kept = without_unfit(logged, kept)
    held = held_out_mask(raw, kept)
    used = held | _evenly_of(raw, ~held, most, settings.data)
    if not used.all():
        raw, clean, held = raw.take(used), clean.take(used), held[used]
    past = settings.data.unknown_past
    unknown = runs_with_unknown_past(clean, past)
    free = after_unknown_past(raw, _fit_for(raw, ~held), unknown, past)
    asked = (options.only, options.without, options.without_because)
    space = build_space(clean.take(free), given.tunable, *asked, still_channels(raw, scales))
    wanted = (options.horizon, *longer_horizons(raw.runs, options.horizon, settings=settings.predict))
    looks = (
        windows_over(runs, robots, noise, h, shorter, kept, spoilt, unknown, settings=settings.predict)
        for shorter, h in pairwise(wanted)
    )
    there = [_with_fewer(look, most, settings.data) for look in looks if look is not None]
    longer = tuple(look for look in there if foretold(look.clean, look.scales, rng, settings=settings.predict))
    near = None
    if there and not longer and foretold(clean, scales, rng, settings=settings.predict):
        shorter = options.horizon * settings.predict.horizons.shorter
        near = windows_between(runs, robots, noise, shorter, kept, spoilt, unknown, settings=settings.predict)
    return Prepared(raw, clean, scales, outliers, kept, held, free, space, longer, near, options)


def _fit_for(data: Dataset, free: np.ndarray) -> np.ndarray:
    """(W,) bool: of the windows that are not held out (W,) those that tell something of the robot, or all if none
    does."""
    fit = free & ~unfit(data)
    return fit if fit.any() else free


def _evenly_of(data: Dataset, free: np.ndarray, most: int, settings: DataSettings) -> np.ndarray:
    """(W,) bool: of the windows that fits may see (W,), every so many, worth at most so many simulation steps."""
    out = np.zeros(data.count, dtype=bool)
    if free.any():
        out[np.flatnonzero(free)[evenly(data.take(free), most, settings=settings)]] = True
    return out


def _with_fewer(look: HorizonWindows, most: int, settings: DataSettings) -> HorizonWindows:
    """The same with fewer windows for the fits, where all would cost more steps."""
    if look.free is None:
        return look
    data, scales = look.free
    return replace(look, free=(thin_whole(data, most, settings=settings), scales))
