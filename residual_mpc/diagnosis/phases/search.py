"""The second phase: the set of effects that the headline's horizon shows, what longer horizons add, and its rivals."""

from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, joined
from residual_mpc.diagnosis.data.gap import Gap, Scales, gap_of
from residual_mpc.diagnosis.data.subsampling import evenly, shorten, thin, thin_whole
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import on_problem
from residual_mpc.diagnosis.fit.noise_fit import with_noise
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, beyond, floor_of, well_begun
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import build_problem, reweigh
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.search.rivals import Rivalry, find_rivals, holds_elsewhere
from residual_mpc.diagnosis.search.stepwise import Found, stepwise_search
from residual_mpc.diagnosis.search.testable import NotTestable, not_testable

BLOCKS = 10  # stretches of time below which a search over longer windows needs a gap to explain: few say anything
CHEAP = 30_000  # simulation steps of one hypothesis up to which longer windows are searched in any case
MOST = 20_000  # simulation steps of one hypothesis on BLOCKS windows beyond which no longer windows are searched
NEAR = 2.0  # times the noise floor within which longer windows sharpen the numbers of the last fit


@dataclass(frozen=True, eq=False)
class Searched:
    """What the search found: the set, its rivals, what these runs cannot show, and the windows that the last fit is to
    see, all of those that fits may see, with the scales of the longest of them."""

    prepared: Prepared
    found: Found
    rivalry: Rivalry
    untestable: tuple[NotTestable, ...]
    windows: Dataset
    scales: Scales


def search_effects(prepared: Prepared, rng: np.random.Generator, progress: Progress) -> Searched:
    """Search the headline's horizon, then each longer one for what it adds; then compare with rival explanations."""
    progress("searching for effects", 0.1)
    steps = prepared.options.final_steps
    # errors that grow within a window hide what made them
    windows = [(shorten(prepared.fitting, 0.5) if prepared.unstable else prepared.fitting, prepared.scales)]
    found = first = _on(prepared, *windows[0], None, rng, lambda text, done: progress(text, 0.1 + 0.4 * done))
    for look in prepared.longer:
        if look.free is None:
            continue
        data, scales = look.free
        data, gap, floor = _seen_over(data, scales, found, prepared, rng)
        sharpens = gap.total < NEAR * floor.total and data.cost <= steps
        cheap = len(np.unique(blocks_of(data))) >= BLOCKS and data.cost <= CHEAP
        bearable = min(BLOCKS, data.count) * data.cost // data.count <= MOST
        if not (cheap or bearable and beyond(gap, floor)):
            if sharpens:
                windows.append((data, scales))
            continue
        progress(f"searching over {data.horizon:g} s", 0.5)
        more = _on(prepared, data, scales, found, rng, lambda text, done: None)
        if more.steps:
            found, windows = more, [(data, scales)]
        elif sharpens:
            windows.append((data, scales))
    progress("comparing with rival explanations", 0.6)
    rivalry = _rivals_that_hold(prepared, found)
    by_noise = reweigh(first.problem, first.problem.data.sigma)
    untestable = not_testable(by_noise, first.base, rivalry.fit.terms)
    return Searched(prepared, found, rivalry, untestable, joined([d for d, _ in windows]), windows[-1][1])


def _rivals_that_hold(prepared: Prepared, found: Found) -> Rivalry:
    """The rivals of what was found; of the rival that holds far better on all windows, where there is one."""
    rivalry = find_rivals(found)
    everywhere = prepared.fitting.take(evenly(prepared.fitting, prepared.options.final_steps))
    better = holds_elsewhere(rivalry, PredictionCache(everywhere, prepared.space), prepared.scales)
    return rivalry if better is None else find_rivals(replace(found, fit=on_problem(found.problem, better)), most=0)


def _on(
    prepared: Prepared,
    windows: Dataset,
    scales: Scales,
    start: Found | None,
    rng: np.random.Generator,
    report: Progress,
) -> Found:
    """The search on these windows, from what an earlier one found."""
    options, space = prepared.options, prepared.space
    # a step of a small robot costs less: a servo on the bench is looked at more closely than an arm
    budget = int(options.search_steps * np.clip(6.0 / len(space.robot.states), 1.0, 2.0))
    few = well_begun(thin(windows, budget) if start is None else thin_whole(windows, budget), scales, rng)
    problem = build_problem(few, space, few.sigma, scales.motion)
    if start is None:
        return stepwise_search(problem, scales, options.search, rng, report)
    more = options.search
    settings = replace(more, over_floor=more.over_floor_longer, largest=more.largest_longer)
    return stepwise_search(problem, scales, settings, rng, report, start.fit.values)


def _seen_over(
    data: Dataset, scales: Scales, found: Found, prepared: Prepared, rng: np.random.Generator
) -> tuple[Dataset, Gap, NoiseFloor]:
    """Longer windows with the noise that what was found leaves there, its gap and its floor."""
    row = prepared.space.settings([found.fit.values])
    predicted = predict(data, row)[0]
    data = with_noise(data, build_problem(data, prepared.space, data.sigma), scales, predicted)
    return data, gap_of(data, scales, data.y - predicted), floor_of(data, scales, row, rng)
