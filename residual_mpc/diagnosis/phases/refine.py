"""The third phase of a diagnosis: what the search found is fitted to the end and questioned, before anything is
opened."""

from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.encoder_consistency import contradicted, independent_encoders
from residual_mpc.diagnosis.data.gap import Scales, gap_of, window_trust
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.cross_validation import expected_errors
from residual_mpc.diagnosis.fit.evidence import blocks_of, least_sure
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.fit.marginalisation import carrying, tolerant
from residual_mpc.diagnosis.fit.polish import Polished, carry_on, polish
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.tolerances import small_differences
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation, MarginalisedFit
from residual_mpc.diagnosis.results.shrink import Shrink, expected_shrink
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.diagnosis.search.stepwise import Found, without
from residual_mpc.diagnosis.search.testable import NotTestable
from residual_mpc.models.settings import Settings, Term, Values

AGAIN = 4  # steps of the last fit with small differences, from where the plain one ended
ROOM = 40_000_000  # numbers in the columns of all small differences
OUTLIERS_WORTH = 0.6  # times the squared noise floor that a few jumping samples have to make of the gap to be a cause


@dataclass(frozen=True, eq=False)
class Searched:
    """What the second phase found: the set, its rivals, what these runs cannot show, and the windows it was found on,
    all of those that fits may see."""

    found: Found
    rivalry: Rivalry
    untestable: tuple[NotTestable, ...]
    windows: Dataset
    scales: Scales


def refine(ready: Prepared, searched: Searched, options: Options, rng: np.random.Generator) -> FittedExplanation:
    """The explanation with its numbers, less the effects that a closer look refutes, and the shrink expected of it."""
    found, windows, scales = searched.found, searched.windows, searched.scales
    problem = build_problem(windows, ready.space, found.sigma, found.problem.motion)
    problem = _trusting(problem, searched.rivalry.fit.values, scales)
    polished, base = polish(problem, [searched.rivalry.fit.values, found.base.values], options.final_steps)
    polished, vetoed = _heed_encoders(problem, polished, options)
    polished, doubtful = _leave_doubtful(problem, polished, options)
    final, before = polished.fit, base.fit
    wide = _tolerating(problem, final)
    spoilt = ready.raw.take(~ready.held)
    row = ready.space.settings([final.values])
    with_outliers = _wanted(ready, options) and (
        ready.outliers.frequent or _weigh(spoilt, ready.fitting, ready.scales, row, rng, options)
    )
    expected = None
    if final.terms or with_outliers:
        expected = _expected(ready, problem, final, before, with_outliers, rng)
    return FittedExplanation(
        ready.raw, ready.clean, ready.scales, ready.kept, ready.held, problem, before, final, polished.ends,
        searched.rivalry, searched.untestable, ready.outliers, with_outliers, vetoed, doubtful, expected,
        None if wide is None else MarginalisedFit(wide, fit_all(wide, [final.values], AGAIN)[0]),
    )  # fmt: skip


def _trusting(problem: Problem, values: Values, scales: Scales) -> Problem:
    """The problem in which windows that diverge under these values weigh less."""
    trust = window_trust(problem.data, scales, problem.data.y - problem.replays([values])[0])
    return problem if (trust == 1.0).all() else replace(problem, count=trust)


def _tolerating(problem: Problem, fit: Fit) -> Problem | None:
    """The problem with small differences marginalised in every number that the fit does not free; None where there are
    none, and where their columns would not fit into memory."""
    if not fit.terms or problem.data.y.size * len(small_differences(problem.space, fit.values)) > ROOM:
        return None
    wide = tolerant(carrying(problem, fit.values, fit.knobs), fit)
    return None if wide.wide is None else wide


def _expected(
    ready: Prepared, problem: Problem, final: Fit, base: Fit, with_outliers: bool, rng: np.random.Generator
) -> Shrink:
    """The shrink, by cross-validation on the windows of the headline's horizon."""
    spoilt = ready.raw.take(~ready.held)
    here = final
    if problem.data.count != ready.fitting.count or problem.data.horizon != ready.raw.horizon:
        plain = build_problem(ready.fitting, ready.space, 1.0 / problem.weight)
        here = on_problem(_trusting(plain, final.values, ready.scales), final)
    before = spoilt.y - predict(spoilt, ready.space.settings([base.values]))[0]
    after = expected_errors(ready.fitting if with_outliers else spoilt, ready.space, here)
    kept_back = ready.raw.take(ready.held) if ready.held.any() else spoilt
    return expected_shrink(spoilt, kept_back, ready.scales, before, after, rng)


def _heed_encoders(problem: Problem, polished: Polished, options: Options) -> tuple[Polished, tuple[Term, ...]]:
    """The fit without the effects that the encoders contradict, and those."""
    final = polished.fit
    if not final.terms or not independent_encoders(problem.data):
        return polished, ()
    rows = [final.values, *(without(final.values, t) for t in final.terms)]
    after, *less = predict(problem.data, problem.space.settings(rows))
    bad = contradicted(problem.data, after, np.stack(less))
    vetoed = tuple(t for t, b in zip(final.terms, bad, strict=True) if b)
    if not vetoed:
        return polished, ()
    left = final.values
    for t in vetoed:
        left = without(left, t)
    return _again(problem, polished, left, options), vetoed


def _leave_doubtful(problem: Problem, polished: Polished, options: Options) -> tuple[Polished, tuple[Term, ...]]:
    """The fit without the effects that cannot be told from none on all windows, and those."""
    blocks, gone = blocks_of(problem.data), list[Term]()
    while (term := least_sure(polished.fit, blocks)) is not None:
        gone.append(term)
        polished = _again(problem, polished, without(polished.fit.values, term), options)
    return polished, tuple(gone)


def _again(problem: Problem, polished: Polished, fewer: Values, options: Options) -> Polished:
    """The fit of some of its numbers, from where it was; other starts are not tried again."""
    fit = carry_on(problem, [fewer], options.final_steps)[0]
    return Polished(fit, {k: (fit.values[k],) for k in fit.knobs})


def _wanted(ready: Prepared, options: Options) -> bool:
    name = "sensor_outliers"
    return ready.outliers.enough and (not options.only or name in options.only) and name not in options.without


def _weigh(
    spoilt: Dataset, clean: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, options: Options
) -> bool:
    """Whether the flagged samples, few as they are, make up much of what the effects leave: the search's own terms."""
    keep = evenly(clean, options.final_steps)
    spoilt, clean = spoilt.take(keep), clean.take(keep)
    left, cleaned = (gap_of(d, scales, d.y - predict(d, row)[0]).total ** 2 for d in (spoilt, clean))
    floor = float(np.mean([gap_of(clean, scales, e).total ** 2 for e in noise_errors(clean, row, rng, 4)]))
    worth = max(OUTLIERS_WORTH * floor, options.search.sizeable * (left - floor))
    return left - cleaned > worth
