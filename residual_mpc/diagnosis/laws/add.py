"""Laws added to an explanation one by one: fitted by replay, kept where they predict what they were not fitted to."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, fit_trust, per_window
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.cross_validation import expected_errors
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.laws.propose import propose, ripples
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.effects.laws import is_law
from residual_mpc.effects.surroundings import TORQUE_RIPPLE
from residual_mpc.models.settings import TUNE, Term, Values


@dataclass(frozen=True, eq=False)
class Unexplained:
    """What laws are fitted to. data: windows that fits may see; sigma (C,): standard deviation of each channel's
    residual; base: the values without any effect; values: those of the explanation so far."""

    data: Dataset
    scales: Scales
    sigma: np.ndarray
    space: Space
    base: Values
    values: Values


@dataclass(frozen=True, eq=False)
class WithLaws:
    """The space that knows the laws' fixed numbers, the values of the explanation with the laws, and their shapes.
    cost: of the fit that chose them, in units of its dispersion."""

    space: Space
    values: Values
    forms: Mapping[Term, str]
    cost: float


@dataclass(frozen=True, eq=False)
class LawSearch:
    """few: the windows of `of` that fits look at to choose."""

    of: Unexplained
    few: Dataset
    tuning: RemainderSettings
    settings: LawSettings


def add_laws(
    of: Unexplained, rng: np.random.Generator, tuning: RemainderSettings, settings: LawSettings
) -> WithLaws | None:
    """The explanation with every law that is beyond doubt on these windows; None where there is none."""
    search = LawSearch(of, of.data.take(evenly(of.data, settings.steps, settings=tuning.data)), tuning, settings)
    found = _first(search, rng)
    for _ in range(settings.most - 1):
        more = None if found is None else _added(search, found.space, found.values, rng)
        if found is None or more is None:
            break
        found = replace(more, forms={**found.forms, **more.forms})
    return found


def _first(search: LawSearch, rng: np.random.Generator) -> WithLaws | None:
    """The first law on top of the named effects; in their place where it does as well without them."""
    of = search.of
    beside = _added(search, of.space, of.values, rng)
    if beside is None or not any(k.effect != TUNE for k in of.values):
        return beside
    alone = _added(search, of.space, of.base, rng)
    doubt = search.tuning.search.beyond_doubt
    return alone if alone is not None and alone.cost - beside.cost < doubt else beside


def _added(search: LawSearch, space: Space, values: Values, rng: np.random.Generator) -> WithLaws | None:
    """The best law on top of the values, less the effects that it makes needless; None where none is convincing."""
    of, few, tuning, settings = search.of, search.few, search.tuning, search.settings
    proposed = propose(of.data, of.scales, space.settings([values]), rng, tuning, settings)
    waves = {t for t in space.candidates if t.effect == TORQUE_RIPPLE.name}
    named = ripples(few, of.scales, space, values, tuning, settings) if waves else ()
    new = (*named, *(p for p in proposed if not waves or p.form != "harmonic"))  # a wave of the angle has a name
    new = tuple(p for p in new if not any(k.effect != TUNE and k.term == p.term for k in values))
    if not new:
        return None
    space = replace(space, fixed={**space.fixed, **{k: v for p in new for k, v in p.fixed.items()}})
    exact = _trusting(build_problem(few, space, of.sigma, settings=tuning.predict), of, tuning)
    problem = on_longer_steps(exact, of.scales, values, settings=tuning.predict)
    starts = [values, *({**values, **p.start} for p in new)]
    current, *laws = fit_all(problem, starts, settings.fit_steps, settings=tuning.fit)
    per_knob = tuning.search.per_knob
    best = int(np.argmin([f.cost + per_knob * len(p.start) for f, p in zip(laws, new, strict=True)]))
    if not _predicts(search, space, current, laws[best], rng):
        return None
    fit = _needed(search, problem, laws[best])
    chosen = {k.term for k in fit.values if k.effect != TUNE}
    fixed = {k: v for k, v in space.fixed.items() if k.term in chosen}
    cost = fit.cost / dispersion(fit, blocks_of(few, settings=tuning.fit))
    return WithLaws(replace(space, fixed=fixed), fit.values, {new[best].term: new[best].form}, cost)


def _predicts(search: LawSearch, space: Space, current: Fit, law: Fit, rng: np.random.Generator) -> bool:
    """Whether the law makes the gap smaller beyond doubt on folds that the fit does without: by some of the jackknife's
    standard errors over stretches of time, and by something that an engineer would see above the noise."""
    few, scales, tuning, settings = search.few, search.of.scales, search.tuning, search.settings
    error = few.y - predict(few, space.settings([current.values]))[0]
    trust = fit_trust(few, scales, error, settings=tuning.data)
    folded = expected_errors(few, space, law, settings=tuning.fit)
    before, after = (np.nan_to_num(trust * per_window(few, scales, e)) for e in (error, folded))
    blocks = blocks_of(few, settings=tuning.fit)
    was, now = (np.bincount(blocks, weights=x) for x in (before, after))
    left = 1.0 - (now.sum() - now) / (was.sum() - was)  # without each stretch
    sigma = np.sqrt(np.var(left) * (len(left) - 1))
    gain = 1.0 - now.sum() / was.sum()
    noise = [np.nansum(per_window(few, scales, e)) for e in noise_errors(few, space.settings([law.values]), rng, 2)]
    seen = was.sum() - now.sum() > tuning.search.over_floor * np.mean(noise)
    return bool(seen and gain >= settings.worth and gain > settings.sure * sigma)


def _needed(search: LawSearch, problem: Problem, fit: Fit) -> Fit:
    """The fit without the named effects that are not beyond doubt beside the law: what imitated it."""
    tuning = search.tuning
    blocks = blocks_of(search.few, settings=tuning.fit)
    while named := [t for t in fit.terms if not is_law(t.effect)]:
        fewer = fit_all(
            problem, [_without(fit.values, t) for t in named], search.settings.fit_steps, settings=tuning.fit
        )
        rises = [(f.cost - fit.cost) / dispersion(fit, blocks) for f in fewer]
        k = int(np.argmin(rises))
        if rises[k] >= tuning.search.beyond_doubt:
            return fit
        fit = fewer[k]
    return fit


def _without(values: Values, term: Term) -> Values:
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}


def _trusting(problem: Problem, of: Unexplained, tuning: RemainderSettings) -> Problem:
    """The problem in which windows that are unlike the others under the explanation so far weigh less."""
    error = problem.data.y - problem.replays([of.values])[0]
    trust = fit_trust(problem.data, of.scales, error, settings=tuning.data)
    return problem if (trust == 1.0).all() else replace(problem, count=trust)
