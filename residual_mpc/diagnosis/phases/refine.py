"""The third phase: what the search found is fitted to the end and questioned, on windows that fits may see."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.encoder_consistency import contradicted, independent_encoders
from residual_mpc.diagnosis.data.gap import Scales, fit_trust, gap_of
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.cross_validation import expected_errors
from residual_mpc.diagnosis.fit.evidence import blocks_of, least_sure
from residual_mpc.diagnosis.fit.least_limits import with_least_limits
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.fit.marginalisation import carrying, tolerant
from residual_mpc.diagnosis.fit.omitted_effects import shifts_beside
from residual_mpc.diagnosis.fit.polish import Polished, carry_on, polish
from residual_mpc.diagnosis.options import Options, Progress
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.search import Searched
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.horizons import HorizonWindows
from residual_mpc.diagnosis.predict.longer_steps import quickened
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem, build_problem, part_of, times_longer
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.tolerances import small_differences
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation, MarginalisedFit
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.shrink import Shrink, expected_shrink
from residual_mpc.diagnosis.results.step_shift import finely_stepped
from residual_mpc.diagnosis.search.optional_numbers import (
    at_bounds,
    freed,
    shifts_without,
    unshown,
    with_all_free,
    without_numbers,
)
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.diagnosis.search.testable import NotTestable
from residual_mpc.effects.sensor import SENSOR_OUTLIERS
from residual_mpc.models.settings import Settings, Term, Values

LAST_RESORT = 4  # times the columns that small differences may have, on the fewest windows that will do


@dataclass(frozen=True, eq=False)
class Refined:
    """The explanation that stands before anything is opened, of the windows `prepared`; scales: of the windows of the
    last fit."""

    explanation: FittedExplanation
    prepared: Prepared
    scales: Scales

    @property
    def longer(self) -> tuple[HorizonWindows, ...]:
        """The longer horizons that it is judged over as well."""
        return self.prepared.longer

    @property
    def options(self) -> Options:
        return self.prepared.options


def refine(searched: Searched, rng: np.random.Generator, progress: Progress) -> Refined:
    """The explanation with its numbers, less the effects that a closer look refutes, and the shrink expected of it."""
    progress("fitting on all windows", 0.6)
    prepared, found, rivalry = searched.prepared, searched.found, searched.rivalry
    options, settings = prepared.options, prepared.options.settings
    motion = found.problem.motion
    times = times_longer(found.problem)
    problem = build_problem(
        searched.windows, prepared.space, found.sigma, motion, times=times, settings=settings.predict
    )
    problem = trusting(problem, rivalry.fit.values, searched.scales, settings)
    starts = [rivalry.fit.values, found.base.values]
    polished, base = polish(problem, starts, options.final_steps, searched.scales, settings=settings.fit)
    fitted = _Fitted(prepared, problem, searched.scales, base.fit, rivalry, searched.untestable)
    return Refined(_explained(fitted, polished, rng), prepared, searched.scales)


def refined_without(refined: Refined, gone: Sequence[Term], rng: np.random.Generator) -> Refined:
    """The explanation less these effects, fitted again from where it was. The shrink expected of it stays as it was
    stated before the held-out windows were opened."""
    of, prepared = refined.explanation, refined.prepared
    fewer = of.final.values
    for term in gone:
        fewer = without(fewer, term)
    fitted = _Fitted(prepared, of.problem, refined.scales, of.base, of.rivalry, of.untestable)
    polished = _again(of.problem, Polished(of.final, dict(of.ends)), fewer, prepared.options)
    now = _explained(fitted, polished, rng)
    terms = now.final.terms
    now = replace(
        now,
        vetoed=(*of.vetoed, *now.vetoed),
        doubtful=(*of.doubtful, *now.doubtful),
        expected=of.expected,
        aside=of.aside,
        serving=of.serving,
        in_parts={t: v for t, v in of.in_parts.items() if t in terms},
        run_sizes={t: v for t, v in of.run_sizes.items() if t in terms},
    )
    return replace(refined, explanation=now)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """What stays as it is while effects leave an explanation; scales: of the windows of the problem."""

    prepared: Prepared
    problem: Problem
    scales: Scales
    base: Fit
    rivalry: Rivalry
    untestable: tuple[NotTestable, ...]


def _explained(fitted: _Fitted, polished: Polished, rng: np.random.Generator) -> FittedExplanation:
    """The explanation less the effects that a closer look refutes, and the shrink expected of it."""
    prepared, problem, base = fitted.prepared, fitted.problem, fitted.base
    options, settings = prepared.options, prepared.options.settings
    polished, vetoed = _heed_encoders(problem, polished, options)
    polished, moved = _choose_numbers(problem, polished, options)
    polished, doubtful = _leave_doubtful(problem, polished, options)
    polished = with_least_limits(problem, polished, settings.fit)
    final = polished.fit
    counts, allowed = _outliers_count(prepared, prepared.space.settings([final.values]), rng), _may_be_named(options)
    with_outliers, unnamed = counts and allowed, counts and not allowed
    expected = None
    if final.terms or with_outliers:
        expected = cross_validated_shrink(prepared, problem, final, base, with_outliers, rng, times_longer(problem))
    tolerated, omitted = _with_small_differences(problem, fitted.scales, final, options)
    omitted += tuple({k: shift.get(k, 0.0) for k in final.knobs} for shift in moved)
    return FittedExplanation(
        prepared.raw, prepared.clean, prepared.scales, prepared.kept, prepared.held, prepared.free, problem, base,
        final, polished.ends, fitted.rivalry, fitted.untestable, prepared.outliers, with_outliers, unnamed, vetoed,
        doubtful, expected, tolerated, omitted,
    )  # fmt: skip


def trusting(problem: Problem, values: Values, scales: Scales, settings: ResultSettings) -> Problem:
    """The problem in which windows that are unlike the others under these values weigh less."""
    trust = fit_trust(problem.data, scales, problem.data.y - problem.replays([values])[0], settings=settings.data)
    return problem if (trust == 1.0).all() else replace(problem, count=trust)


def _with_small_differences(
    problem: Problem, scales: Scales, final: Fit, options: Options
) -> tuple[MarginalisedFit | None, tuple[Values, ...]]:
    """The last fit with small differences marginalised in every number that it does not free, None where the residuals
    show none; and how its numbers move beside single ones. On evenly chosen windows where the columns would take too
    much time or memory on all, nothing where not even the fewest windows would do."""
    settings, phases = options.settings.fit, options.phases
    differences = small_differences(problem.space, final.values, final.knobs, settings=settings.predict)
    count = len(differences)
    size = problem.data.y.size * count
    if not final.terms or not count:
        return None, ()
    steps = min(phases.marginal_cost // count, problem.data.cost * phases.marginal_columns // size)
    keep = evenly(problem.data, steps, settings=options.settings.data)
    part = problem if keep.all() else part_of(problem, keep)
    if part.data.y.size * count > LAST_RESORT * phases.marginal_columns:
        return None, ()
    plain = final if part is problem else fit_all(part, [final.values], phases.marginal_steps, settings=settings)[0]
    quick = quickened(part.data, scales, settings=settings.predict)
    by = None if quick is part.data else PredictionCache(quick, part.space)
    carried, share = carrying(part, final.values, final.knobs, by, settings=settings), float(keep.mean())
    omitted = shifts_beside(carried, plain, differences, phases.marginal_steps, settings=settings)
    wide = tolerant(carried, plain, settings=settings, share=share)
    if wide.marginal is None:
        return None, omitted
    marginalised = fit_all(wide, [final.values], phases.marginal_steps, settings=settings)[0]
    return MarginalisedFit(wide, marginalised, part, plain), omitted


def cross_validated_shrink(
    prepared: Prepared,
    problem: Problem,
    final: Fit,
    base: Fit,
    with_outliers: bool,
    rng: np.random.Generator,
    times: int = 1,
) -> Shrink:
    """The shrink, by cross-validation on the windows of the headline's horizon. times: see build_problem."""
    settings = prepared.options.settings
    spoilt = prepared.raw.take(prepared.free)
    here = final
    if problem.data.count != prepared.fitting.count or problem.data.horizon != prepared.raw.horizon:
        sigma = 1.0 / problem.weight
        plain = build_problem(prepared.fitting, prepared.space, sigma, times=times, settings=settings.predict)
        here = on_problem(trusting(plain, final.values, prepared.scales, settings), final, settings=settings.fit)
    before = spoilt.y - predict(spoilt, prepared.space.settings([base.values]))[0]
    after = expected_errors(prepared.fitting if with_outliers else spoilt, prepared.space, here, settings=settings.fit)
    kept_back = prepared.raw.take(prepared.held) if prepared.held.any() else spoilt
    return expected_shrink(spoilt, kept_back, prepared.scales, before, after, rng, settings=settings)


def _heed_encoders(problem: Problem, polished: Polished, options: Options) -> tuple[Polished, tuple[Term, ...]]:
    """The fit without the effects that the encoders contradict, and those."""
    final = polished.fit
    if not final.terms or not independent_encoders(problem.data):
        return polished, ()
    settings = options.settings
    rows = [final.values, *(without(final.values, t) for t in final.terms)]
    after, *less = predict(problem.data, problem.space.settings(rows))
    bad = contradicted(problem.data, after, np.stack(less), settings=settings.data)
    vetoed = tuple(t for t, b in zip(final.terms, bad, strict=True) if b)
    if not vetoed:
        return polished, ()
    left = final.values
    for t in vetoed:
        left = without(left, t)
    return _again(problem, polished, left, options), vetoed


def _choose_numbers(problem: Problem, polished: Polished, options: Options) -> tuple[Polished, tuple[Values, ...]]:
    """The fit with those optional numbers that all windows show, no more than the search did on few; and how far
    the others could shift it, see `shifts_without`."""
    space, settings = problem.space, options.settings.fit
    most = len(freed(polished.fit.values))
    if not most:
        return polished, ()
    every = with_all_free(space, polished.fit.values)
    whole = _again(problem, polished, every, options)
    finer, blocks = finely_stepped(problem, whole.fit), blocks_of(problem.data, settings=settings)
    bounded = at_bounds(space, whole.fit)
    gone = (*bounded, *unshown(space, whole.fit, finer, most, blocks, settings))
    kept = without_numbers(whole.fit.values, *gone)
    chosen = polished if kept.keys() == polished.fit.values.keys() else _again(problem, polished, kept, options)
    left_out = [k for k in gone if k not in bounded]
    return chosen, shifts_without(space, whole.fit, left_out, blocks)


def _leave_doubtful(problem: Problem, polished: Polished, options: Options) -> tuple[Polished, tuple[Term, ...]]:
    """The fit without the effects that cannot be told from none on all windows, and those."""
    settings = options.settings
    blocks, gone = blocks_of(problem.data, settings=settings.fit), list[Term]()
    while True:
        finer = finely_stepped(problem, polished.fit)
        term = least_sure(polished.fit, blocks, finer, settings=settings.fit)
        if term is None:
            return polished, tuple(gone)
        gone.append(term)
        polished = _again(problem, polished, without(polished.fit.values, term), options)


def _again(problem: Problem, polished: Polished, fewer: Values, options: Options) -> Polished:
    """The fit of some of its numbers, from where it was; other starts are not tried again."""
    settings = options.settings
    fit = carry_on(problem, [fewer], options.final_steps, settings=settings.fit)[0]
    return Polished(fit, {k: (fit.values[k],) for k in fit.knobs})


def _outliers_count(prepared: Prepared, row: Settings, rng: np.random.Generator) -> bool:
    """Whether the samples that jump away are a cause: they are enough to be no accident, and are either frequent or
    make up much of what the effects (one row of settings) leave."""
    return prepared.outliers.enough and (prepared.outliers.frequent or _weigh(prepared, row, rng))


def _may_be_named(options: Options) -> bool:
    """Whether samples that jump away may be named as a cause."""
    name = SENSOR_OUTLIERS.name
    return (not options.only or name in options.only) and name not in options.without


def _weigh(prepared: Prepared, row: Settings, rng: np.random.Generator) -> bool:
    """Whether the flagged samples, few as they are, make up much of what the effects leave: the search's own terms."""
    options, clean, scales = prepared.options, prepared.fitting, prepared.scales
    settings = options.settings
    keep = evenly(clean, options.final_steps, settings=settings.data)
    spoilt, clean = prepared.raw.take(prepared.free).take(keep), clean.take(keep)
    left, cleaned = (gap_of(d, scales, d.y - predict(d, row)[0]).total ** 2 for d in (spoilt, clean))
    floor = float(np.mean([gap_of(clean, scales, e).total ** 2 for e in noise_errors(clean, row, rng, 4)]))
    worth = max(options.phases.outliers_worth * floor, settings.search.sizeable * (left - floor))
    return left - cleaned > worth
