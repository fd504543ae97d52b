"""What a comparison compares: windows of both sets, the changes that may be found, and the stretches of the test."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.conditions import balanced, conditions_of, driving_of, unlike_of
from residual_mpc.comparison.sets import TwoSets, cut, units_of, windows_of
from residual_mpc.comparison.settings import ComparisonSettings, ContrastSettings
from residual_mpc.comparison.space import ChangeSpace, change_space
from residual_mpc.comparison.units import Units, averaged, build_units
from residual_mpc.diagnosis.data.dataset import Dataset, joined
from residual_mpc.diagnosis.data.gap import Scales, measure_scales, still_channels
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.channel_weights import weighed_by_residuals
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.horizons import foretold, longer_horizons
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.references import ends_of
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values


@dataclass(frozen=True, eq=False)
class ComparisonInput:
    """robots: the nominal model of each run, those before first; noise, tunable: as a diagnosis has them."""

    before: tuple[Run, ...]
    after: tuple[Run, ...]
    robots: tuple[Robot, ...]
    noise: Mapping[str, float]
    tunable: tuple[str, ...]
    options: Options


def cut_sets(given: ComparisonInput, settings: ComparisonSettings) -> TwoSets:
    """Both sets in windows of the headline's horizon. Raises BadInput where one of them has nothing to compare."""
    data = settings.results.data
    return cut(given.before, given.after, given.robots, given.noise, given.options.horizon, data)


def windows_for(
    given: ComparisonInput, sets: TwoSets, rng: np.random.Generator, settings: ComparisonSettings
) -> list[tuple[Dataset, Scales]]:
    """The windows of the fits and the test: those of the headline's horizon, and with them longer ones, where the
    motion can be predicted that far: what adds up slowly shows there. Where it cannot, since errors grow, shorter ones
    alone: the few windows that diverge hide there what changed."""
    results, horizon = settings.results, given.options.horizon
    here = (sets.clean, sets.scales)
    for longer in longer_horizons(sets.raw.runs, horizon, settings=results.predict)[:1]:
        whole = windows_of(sets, given.robots, given.noise, longer, results.data)
        if whole is None:
            continue
        if foretold(*whole, rng, settings=results.predict):
            return [here, (joined([sets.clean, whole[0]]), whole[1])]
        shorter = horizon * results.predict.horizons.shorter
        near = windows_of(sets, given.robots, given.noise, shorter, results.data)
        return [here if near is None else near]
    return [here]


def space_for(given: ComparisonInput, sets: TwoSets) -> ChangeSpace:
    """The changes that these runs of this robot could show. Raises BadInput where there are none."""
    options = given.options
    asked = (options.only, options.without, options.without_because)
    still = still_channels(sets.clean, measure_scales(sets.clean))
    whole = build_space(sets.clean, given.tunable, *asked, still)
    if not whole.candidates:
        raise BadInput(
            "no effect is left that these runs of this robot could show to have changed",
            "`only`" if options.only else "`without`" if options.without else "",
            "leave out fewer effects, or record longer runs",
        )
    ends = ends_of(sets.clean, np.flatnonzero(sets.later).tolist())
    return change_space(whole, given.robots[: len(given.before)], given.robots[len(given.before) :], ends)


def problem_on(
    data: Dataset, scales: Scales, space: ChangeSpace, values: Values, steps: int, settings: ComparisonSettings
) -> Problem:
    """The problem on `steps` simulation steps' worth of windows of each set, each channel weighed by what these values
    leave, windows that are unlike the others weighing less."""
    results = settings.results
    keep = np.zeros(data.count, dtype=bool)
    later = np.concatenate([np.full(b.where.stop - b.where.start, b.group == 1) for b in data.blocks])
    for side in (later, ~later):
        keep[np.flatnonzero(side)[evenly(data.take(side), steps // 2, settings=results.data)]] = True
    few = data.take(keep)
    problem = build_problem(few, space, few.sigma, scales.motion, settings=results.predict)
    return weighed_by_residuals(problem, scales, values, results.data)


def units_for(data: Dataset, sets: TwoSets, given: ComparisonInput, settings: ComparisonSettings) -> Units:
    """The stretches of these windows and how they were driven. Raises BadInput where a set has too few of them."""
    units = stretches_of(data, sets, given, settings)
    units = with_driving(units, averaged(driving_of(data), units.number, units.count), settings.contrast)
    for name, n in (("before", int((~units.later).sum())), ("after", int(units.later.sum()))):
        if n < settings.contrast.fewest:
            raise BadInput(
                f"at least {settings.contrast.fewest} independent stretches are needed {name} the change, got {n}",
                f"--{name}",
                f"record more or longer runs: a stretch has {settings.contrast.unit:g} s or more",
            )
    return units


def stretches_of(data: Dataset, sets: TwoSets, given: ComparisonInput, settings: ComparisonSettings) -> Units:
    """The stretches of these windows, with the conditions that do not depend on which set a run belongs to, and with
    those in which the sets are driven differently."""
    number = units_of(data, sets.later, settings.contrast)
    conditions = conditions_of(data, sets.scales, given.robots, sets.later)
    unlike = unlike_of(data, sets.side(data), settings.unlike)
    return build_units(number, sets.side(data), data.run, np.column_stack([conditions, unlike]))


def with_driving(units: Units, driving: np.ndarray, settings: ContrastSettings) -> Units:
    """The units with how they were commanded as further conditions, of driving (U, k) as many as so many units can
    bear."""
    extra = balanced(driving, units.later, units.count // settings.units_per_condition, settings.balanced)
    return replace(units, conditions=np.column_stack([units.conditions, extra]))
