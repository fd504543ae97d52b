"""The whole diagnosis, in order: gap, where, which, how far."""

from collections.abc import Callable, Sequence

import numpy as np

from residual_mpc.diagnosis.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.evidence import blocks_of
from residual_mpc.diagnosis.explained import Explained
from residual_mpc.diagnosis.fit import Fit, fit_all
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Scales, gap_of, measure_scales, per_window
from residual_mpc.diagnosis.hold_out import choose_held_out, held_out_mask
from residual_mpc.diagnosis.how_far import expected_errors, foretold
from residual_mpc.diagnosis.learner import RidgeLearner
from residual_mpc.diagnosis.opened import Made, open_held_out
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.problem import Problem, build_problem, part_of
from residual_mpc.diagnosis.remainder import Learner
from residual_mpc.diagnosis.replay import predict, with_outliers_removed
from residual_mpc.diagnosis.rivals import find_rivals
from residual_mpc.diagnosis.search import search, without
from residual_mpc.diagnosis.significance import least_sure
from residual_mpc.diagnosis.space import build_space
from residual_mpc.diagnosis.spikes import Outliers, find_outliers
from residual_mpc.diagnosis.testable import not_testable
from residual_mpc.diagnosis.thinning import evenly, thin, well_begun
from residual_mpc.diagnosis.witness import contradicted, witnesses
from residual_mpc.logs.run import Run
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Term, Values

Progress = Callable[[str, float], None]
POLISH, POLISH_TOLERANCE = 24, 1e-6  # steps and relative gain at which the last fit ends
LAST = 2  # of these steps that are on all windows, where there are too many for all


def diagnose(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: dict[str, float],
    tunable: Sequence[str],
    options: Options,
    rng: np.random.Generator,
    progress: Progress = lambda stage, done: None,
    learners: Sequence[Learner] = (RidgeLearner(),),
) -> Made:
    """robots[i] is the nominal model of runs[i]; learners: who is asked what can be learned of the rest.

    Raises BadInput where nothing can be compared.
    """
    progress("cutting the runs into windows", 0.02)
    raw = build_dataset(runs, robots, noise, options.horizon)
    scales = measure_scales(raw)
    outliers = find_outliers(raw)
    clean = with_outliers_removed(raw, outliers.flagged)
    kept = options.held_out
    if kept is None:
        kept = choose_held_out(raw, per_window(raw, scales, raw.y - predict(raw, Settings(1))[0]))
    held = held_out_mask(raw, kept)

    fitting = clean.take(~held)
    space = build_space(fitting, tunable, options.only, options.without, options.without_because)
    progress("searching for effects", 0.1)
    # a step of a small robot costs less: a servo on the bench is looked at more closely than an arm
    budget = int(options.search_steps * np.clip(6.0 / len(space.robot.states), 1.0, 2.0))
    few = well_begun(thin(fitting, budget), scales, rng)
    by_noise = build_problem(few, space, few.sigma)
    found = search(
        by_noise,
        scales,
        options.search,
        rng,
        lambda text, done: progress(text, 0.1 + 0.5 * done),
    )
    progress("comparing with rival explanations", 0.6)
    rivalry = find_rivals(found)
    untestable = not_testable(by_noise, found.base, rivalry.fit.terms)

    progress("fitting on all windows", 0.75)
    problem = build_problem(fitting, space, 1.0 / found.problem.weight)  # with the weights of the search
    final, base = polish(problem, [rivalry.fit.values, found.base.values], options.final_steps)
    before_fit = raw.take(~held)
    final, vetoed = _heed_witnesses(problem, final, options)
    final, doubtful = _leave_doubtful(problem, final, options)
    with_outliers = _wanted(outliers, options) and (
        outliers.frequent or _weigh(before_fit, fitting, scales, space.settings([final.values]), rng, options)
    )
    progress("stating the expected shrink", 0.85)
    base_error = before_fit.y - predict(before_fit, space.settings([base.values]))[0]
    expected = None
    if final.terms or with_outliers:
        kept_back = raw.take(held) if held.any() else before_fit
        after = expected_errors(fitting if with_outliers else before_fit, space, final)
        expected = foretold(before_fit, kept_back, scales, base_error, after, rng)

    progress("opening the held-out windows", 0.9)
    explained = Explained(
        raw, clean, scales, kept, held, problem, base, final, rivalry, untestable, outliers, with_outliers, vetoed,
        doubtful, expected,
    )  # fmt: skip
    return open_held_out(explained, options, rng, learners)


def polish(problem: Problem, starts: list[Values], steps: int) -> list[Fit]:
    """Fit to the end: on `steps` simulation steps' worth of windows, evenly spread, and the last steps on all."""
    few = evenly(problem.data, steps)
    if few.all():
        return fit_all(problem, starts, POLISH, POLISH_TOLERANCE, secants=0)
    near = fit_all(part_of(problem, few), starts, POLISH, POLISH_TOLERANCE, rough=True)
    return fit_all(problem, [f.values for f in near], LAST, POLISH_TOLERANCE, secants=0)


def _heed_witnesses(problem: Problem, final: Fit, options: Options) -> tuple[Fit, tuple[Term, ...]]:
    """The fit without the effects that the encoders contradict, and those."""
    if not final.terms or not witnesses(problem.data):
        return final, ()
    rows = [final.values, *(without(final.values, t) for t in final.terms)]
    after, *less = predict(problem.data, problem.space.settings(rows))
    bad = contradicted(problem.data, after, np.stack(less))
    vetoed = tuple(t for t, b in zip(final.terms, bad, strict=True) if b)
    if not vetoed:
        return final, ()
    left = final.values
    for t in vetoed:
        left = without(left, t)
    return polish(problem, [left], options.final_steps)[0], vetoed


def _leave_doubtful(problem: Problem, final: Fit, options: Options) -> tuple[Fit, tuple[Term, ...]]:
    """The fit without the effects that cannot be told from none on all windows, and those."""
    blocks, gone = blocks_of(problem.data), list[Term]()
    while (term := least_sure(final, blocks)) is not None:
        gone.append(term)
        final = polish(problem, [without(final.values, term)], options.final_steps)[0]
    return final, tuple(gone)


def _wanted(outliers: Outliers, options: Options) -> bool:
    name = "sensor_outliers"
    return outliers.enough and (not options.only or name in options.only) and name not in options.without


def _weigh(
    spoilt: Dataset, clean: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, options: Options
) -> bool:
    """Whether the flagged samples, few as they are, make up much of what the effects leave: the search's own terms."""
    keep = evenly(clean, options.final_steps)
    spoilt, clean = spoilt.take(keep), clean.take(keep)
    left, cleaned = (gap_of(d, scales, d.y - predict(d, row)[0]).total ** 2 for d in (spoilt, clean))
    floor = float(np.mean([gap_of(clean, scales, e).total ** 2 for e in noise_errors(clean, row, rng, 4)]))
    worth = max(options.search.over_floor * floor, options.search.sizeable * (left - floor))
    return left - cleaned > worth
