"""Laws added to an explanation one by one: fitted by replay, kept where they predict what they were not fitted to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, per_window, window_trust
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.cross_validation import expected_errors
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.laws.propose import Proposal, propose
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.effects.laws import is_law
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
    """The space that knows the laws' fixed numbers, the values of the explanation with the laws, and their shapes."""

    space: Space
    values: Values
    forms: Mapping[Term, str]


def add_laws(
    of: Unexplained, rng: np.random.Generator, tuning: RemainderSettings, settings: LawSettings
) -> WithLaws | None:
    """The explanation with every law that is beyond doubt on these windows; None where there is none."""
    few = of.data.take(evenly(of.data, settings.steps, settings=tuning.data))
    found: WithLaws | None = None
    for _ in range(settings.most):
        space, values = (of.space, of.values) if found is None else (found.space, found.values)
        row = space.settings([values])
        new = propose(of.data, of.scales, row, rng, tuning, settings)
        new = tuple(p for p in new if not any(k.effect != TUNE and k.term == p.term for k in values))
        better = _best(few, of, space, values, new, rng, tuning, settings) if new else None
        if better is None:
            break
        found = replace(better, forms={**({} if found is None else found.forms), **better.forms})
    return found


def _best(
    few: Dataset, of: Unexplained, space: Space, values: Values, new: Sequence[Proposal], rng: np.random.Generator,
    tuning: RemainderSettings, settings: LawSettings,
) -> WithLaws | None:  # fmt: skip
    """The best of the proposed laws on top of the values, less the effects that it makes needless; None where it is
    not convincing."""
    search = tuning.search
    space = replace(space, fixed={**space.fixed, **{k: v for p in new for k, v in p.fixed.items()}})
    problem = _trusting(build_problem(few, space, of.sigma, settings=tuning.predict), of.scales, values, tuning)
    blocks = blocks_of(few, settings=search.fit)
    starts = [values, *({**values, **p.start} for p in new)]
    current, *laws = fit_all(problem, starts, settings.fit_steps, settings=search.fit)
    best = int(np.argmin([f.cost + search.per_knob * len(p.start) for f, p in zip(laws, new, strict=True)]))
    if not _predicts(few, of.scales, space, current, laws[best], rng, tuning, settings):
        return None
    fit = _needed(problem, laws[best], blocks, tuning, settings)
    chosen = {k.term for k in fit.values if k.effect != TUNE}
    fixed = {k: v for k, v in space.fixed.items() if k.term in chosen}
    return WithLaws(replace(space, fixed=fixed), fit.values, {new[best].term: new[best].shape.form})


def _predicts(
    few: Dataset, scales: Scales, space: Space, current: Fit, law: Fit, rng: np.random.Generator,
    tuning: RemainderSettings, settings: LawSettings,
) -> bool:  # fmt: skip
    """Whether the law makes the gap smaller beyond doubt on folds that the fit does without: by more than twice the
    jackknife's standard error over stretches of time, and by something that an engineer would see above the noise."""
    error = few.y - predict(few, space.settings([current.values]))[0]
    trust = window_trust(few, scales, error, settings=tuning.data)
    folded = expected_errors(few, space, law, settings=tuning.fit)
    before, after = (np.nan_to_num(trust * per_window(few, scales, e)) for e in (error, folded))
    blocks = blocks_of(few, settings=tuning.fit)
    was, now = (np.bincount(blocks, weights=x) for x in (before, after))
    left = 1.0 - (now.sum() - now) / (was.sum() - was)  # without each stretch
    sigma = np.sqrt(np.var(left) * (len(left) - 1))
    gain = 1.0 - now.sum() / was.sum()
    floor = np.mean([per_window(few, scales, e).sum() for e in noise_errors(few, space.settings([law.values]), rng, 2)])
    seen = was.sum() - now.sum() > tuning.search.over_floor * floor
    return bool(seen and gain >= settings.worth and gain > settings.sure * sigma)


def _needed(problem: Problem, fit: Fit, blocks: np.ndarray, tuning: RemainderSettings, settings: LawSettings) -> Fit:
    """The fit without the named effects that are not beyond doubt beside the law: what imitated it."""
    search = tuning.search
    while True:
        named = [t for t in fit.terms if not is_law(t.effect)]
        if not named:
            return fit
        fewer = fit_all(problem, [_without(fit.values, t) for t in named], settings.fit_steps, settings=search.fit)
        rises = [(f.cost - fit.cost) / dispersion(fit, blocks) for f in fewer]
        k = int(np.argmin(rises))
        if rises[k] >= search.beyond_doubt:
            return fit
        fit = fewer[k]


def _without(values: Values, term: Term) -> Values:
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}


def _trusting(problem: Problem, scales: Scales, values: Values, tuning: RemainderSettings) -> Problem:
    """The problem in which windows that diverge under these values weigh less."""
    error = problem.data.y - problem.replays([values])[0]
    trust = window_trust(problem.data, scales, error, settings=tuning.data)
    return problem if (trust == 1.0).all() else replace(problem, count=trust)
