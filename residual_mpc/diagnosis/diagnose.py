"""The whole diagnosis, in order: prepare, search, refine, evaluate on held-out data."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.diagnosis.dataset import Dataset, joined
from residual_mpc.diagnosis.evidence import blocks_of
from residual_mpc.diagnosis.fit import on_problem
from residual_mpc.diagnosis.gap import Gap, Scales, gap_of
from residual_mpc.diagnosis.learner import RidgeLearner
from residual_mpc.diagnosis.noise_fit import with_noise
from residual_mpc.diagnosis.opened import Made, open_held_out
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.prepare import Prepared, prepare
from residual_mpc.diagnosis.problem import build_problem, reweigh
from residual_mpc.diagnosis.records import Diagnosis
from residual_mpc.diagnosis.refine import Searched, refine
from residual_mpc.diagnosis.remainder import Learner
from residual_mpc.diagnosis.replay import predict
from residual_mpc.diagnosis.replays import Replays
from residual_mpc.diagnosis.rivals import find_rivals, holds_elsewhere
from residual_mpc.diagnosis.screen import shorten
from residual_mpc.diagnosis.search import Found, search
from residual_mpc.diagnosis.testable import not_testable
from residual_mpc.diagnosis.thinning import evenly, thin, thin_whole, well_begun
from residual_mpc.diagnosis.verdict import Floor, beyond, floor_of
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot

Progress = Callable[[str, float], None]

BLOCKS = 10  # stretches of time below which a search over longer windows needs a gap to explain: few say anything
CHEAP = 30_000  # simulation steps of one hypothesis up to which longer windows are searched in any case
MOST = 20_000  # simulation steps of one hypothesis on BLOCKS windows beyond which no longer windows are searched
NEAR = 2.0  # times the noise floor within which longer windows sharpen the numbers of the last fit


def diagnose(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: dict[str, float],
    tunable: Sequence[str],
    options: Options,
    rng: np.random.Generator,
    progress: Progress = lambda stage, done: None,
    learners: Sequence[Learner] = (RidgeLearner(),),
    answered: Callable[[Diagnosis], None] = lambda diagnosis: None,
) -> Made:
    """robots[i] is the nominal model of runs[i]; learners: those that try to learn what is left; answered: told the
    answer as soon as it stands, before what is left is described.

    Raises BadInput where nothing can be compared.
    """
    with threadpool_limits(1, "blas"):  # matrices of this size lose by a second thread
        progress("splitting the runs into windows", 0.02)
        ready = prepare(runs, robots, noise, tunable, options, rng)
        progress("searching for effects", 0.1)
        searched = _search(ready, options, rng, progress)
        progress("fitting on all windows", 0.75)
        explained = refine(ready, searched, options, rng)
        progress("evaluating on the held-out windows", 0.85)
        return open_held_out(explained, ready.longer, options, rng, learners, progress, answered)


def _search(ready: Prepared, options: Options, rng: np.random.Generator, progress: Progress) -> Searched:
    """The set of effects that the headline's horizon shows, and what longer ones add to it."""
    # errors that grow within a window hide what made them
    windows = [(shorten(ready.fitting, 0.5) if ready.unstable else ready.fitting, ready.scales)]
    found = first = _on(ready, *windows[0], None, options, rng, lambda text, done: progress(text, 0.1 + 0.4 * done))
    for look in ready.longer:
        if look.free is None:
            continue
        data, scales = look.free
        data, gap, floor = _seen_over(data, scales, found, ready, rng)
        sharpens = gap.total < NEAR * floor.total and data.cost <= options.final_steps
        cheap = len(np.unique(blocks_of(data))) >= BLOCKS and data.cost <= CHEAP
        bearable = min(BLOCKS, data.count) * data.cost // data.count <= MOST
        if not (cheap or bearable and beyond(gap, floor)):
            if sharpens:
                windows.append((data, scales))
            continue
        progress(f"searching over windows of {data.horizon:g} s", 0.5)
        more = _on(ready, data, scales, found, options, rng, lambda text, done: None)
        if more.steps:
            found, windows = more, [(data, scales)]
        elif sharpens:
            windows.append((data, scales))
    progress("comparing with alternative explanations", 0.6)
    rivalry = find_rivals(found)
    everywhere = ready.fitting.take(evenly(ready.fitting, options.final_steps))
    better = holds_elsewhere(rivalry, Replays(everywhere, ready.space), ready.scales)
    if better is not None:
        rivalry = find_rivals(replace(found, fit=on_problem(found.problem, better)), most=0)
    by_noise = reweigh(first.problem, first.problem.data.sigma)
    untestable = not_testable(by_noise, first.base, rivalry.fit.terms)
    return Searched(found, rivalry, untestable, joined([d for d, _ in windows]), windows[-1][1])


def _on(
    ready: Prepared,
    windows: Dataset,
    scales: Scales,
    start: Found | None,
    options: Options,
    rng: np.random.Generator,
    report: Progress,
) -> Found:
    """The search on these windows, from what an earlier one found."""
    # a step of a small robot costs less: a servo on the bench is looked at more closely than an arm
    budget = int(options.search_steps * np.clip(6.0 / len(ready.space.robot.states), 1.0, 2.0))
    few = well_begun(thin(windows, budget) if start is None else thin_whole(windows, budget), scales, rng)
    problem = build_problem(few, ready.space, few.sigma, scales.motion)
    if start is None:
        return search(problem, scales, options.search, rng, report)
    more = options.search
    settings = replace(more, over_floor=more.over_floor_longer, largest=more.largest_longer)
    return search(problem, scales, settings, rng, report, start.fit.values)


def _seen_over(
    data: Dataset, scales: Scales, found: Found, ready: Prepared, rng: np.random.Generator
) -> tuple[Dataset, Gap, Floor]:
    """Longer windows with the noise that what was found leaves there, its gap and its floor."""
    row = ready.space.settings([found.fit.values])
    predicted = predict(data, row)[0]
    data = with_noise(data, build_problem(data, ready.space, data.sigma), scales, predicted)
    return data, gap_of(data, scales, data.y - predicted), floor_of(data, scales, row, rng)
