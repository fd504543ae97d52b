"""The first phase: the runs cut into windows, what is held out of them, and the hypotheses."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales, measure_scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.data.outliers import Outliers, find_outliers
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.predict.horizons import (
    HorizonWindows,
    foretold,
    longer_horizons,
    windows_between,
    windows_over,
)
from residual_mpc.diagnosis.predict.replay import predict, with_outliers_removed
from residual_mpc.diagnosis.predict.space import Space, build_space
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
    """raw: all W windows as they were logged; clean: less the samples that jump away. kept, held (W,) bool: what no fit
    may see; longer: the same runs over the longer horizons that the nominal model can predict; near: shorter windows
    that fits may see, with their scales, if the model can predict the headline's horizon but no longer one. Errors then
    grow so fast that a few diverging windows of the headline's horizon would dominate the fit."""

    raw: Dataset
    clean: Dataset
    scales: Scales
    outliers: Outliers
    kept: tuple[KeptBack, ...]
    held: np.ndarray
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
        return self.clean.take(~self.held)


def prepare(given: DiagnosisInput, rng: np.random.Generator, progress: Progress) -> Prepared:
    """Raises BadInput where nothing can be compared."""
    progress("splitting the runs into windows", 0.02)
    runs, robots, noise, options = given.runs, given.robots, given.noise, given.options
    settings = options.settings
    raw = build_dataset(runs, robots, noise, options.horizon, settings=settings.data)
    scales = measure_scales(raw)
    outliers = find_outliers(raw, settings=settings.data)
    clean = with_outliers_removed(raw, outliers.flagged)
    kept = options.held_out
    if kept is None:
        missed = per_window(raw, scales, raw.y - predict(raw, Settings(1))[0])
        kept = choose_held_out(raw, missed, settings=settings.data)
    held = held_out_mask(raw, kept)
    space = build_space(clean.take(~held), given.tunable, options.only, options.without, options.without_because)
    wanted = (options.horizon, *longer_horizons(raw.runs, options.horizon, settings=settings.predict))
    looks = (
        windows_over(runs, robots, noise, h, shorter, kept, outliers.flagged, settings=settings.predict)
        for shorter, h in pairwise(wanted)
    )
    there = [look for look in looks if look is not None]
    longer = tuple(look for look in there if foretold(look.clean, look.scales, rng, settings=settings.predict))
    near = None
    if there and not longer and foretold(clean, scales, rng, settings=settings.predict):
        shorter = options.horizon * settings.predict.horizons.shorter
        near = windows_between(runs, robots, noise, shorter, kept, outliers.flagged, settings=settings.predict)
    return Prepared(raw, clean, scales, outliers, kept, held, space, longer, near, options)
