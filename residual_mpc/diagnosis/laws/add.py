"""Laws added to an explanation one by one: fitted by replay, kept where they predict what they were not fitted to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, fit_trust, per_window
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.cross_validation import expected_errors
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.laws.named import named_twin, replaced, taken_up
from residual_mpc.diagnosis.laws.proposal import Proposal
from residual_mpc.diagnosis.laws.propose import propose, ripples
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.effects.laws import KNOTS, curve, is_law
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.surroundings import TORQUE_RIPPLE
from residual_mpc.models.settings import TUNE, Knob, Term, Values


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
    """The space that knows the laws' fixed numbers, the values of the explanation with the laws, and the laws as they
    were proposed. cost: of the fit that chose them; spread: its dispersion."""

    space: Space
    values: Values
    laws: Mapping[Term, Proposal]
    cost: float
    spread: float

    @property
    def forms(self) -> dict[Term, str]:
        """The shape of each law."""
        return {term: law.form for term, law in self.laws.items()}


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
    """The explanation with every law that is beyond doubt on these windows; None where there is none.

    Laws are added to the named effects, and to the model without them: effects that together imitate a law hide it.
    What was named may then return.
    """
    search = LawSearch(of, of.data.take(evenly(of.data, settings.steps, settings=tuning.data)), tuning, settings)
    named = _grown(search, WithLaws(of.space, of.values, {}, np.inf, np.inf), rng)
    if all(k.effect == TUNE for k in of.values):
        return named
    bare = _grown(search, WithLaws(of.space, of.base, {}, np.inf, np.inf), rng)
    if bare is None:
        return named
    kept = _as_it_is(search, of.values) if named is None else named
    spread = min(bare.spread, kept.spread)  # a poor fit has a large dispersion, which would excuse what it leaves
    costs = [g.cost + spread * _price(g.values, tuning) for g in (bare, kept)]
    gives_up = any(not is_law(t.effect) for t in _terms(kept.values) - _terms(bare.values))
    better = costs[0] < costs[1] and (not gives_up or _clearer(search, bare, kept))
    return bare if better else named


def _as_it_is(search: LawSearch, values: Values) -> WithLaws:
    """An explanation without laws."""
    problem = _problem(search, search.of.space, values)
    (fit,) = fit_all(problem, [values], search.settings.fit_steps, settings=search.tuning.fit)
    spread = dispersion(fit, blocks_of(search.few, settings=search.tuning.fit))
    return WithLaws(search.of.space, values, {}, fit.cost, spread)


def _clearer(search: LawSearch, bare: WithLaws, named: WithLaws) -> bool:
    """Whether an explanation that gives up a named effect needs fewer terms, or explains more by a share that counts: a
    curve of many numbers imitates any effect, and follows some of what the effect leaves as well."""
    if len(_terms(bare.values)) < len(_terms(named.values)):
        return True
    explained = _as_it_is(search, search.of.base).cost - named.cost
    return named.cost - bare.cost > search.settings.instead * explained


def _price(values: Values, tuning: RemainderSettings) -> float:
    """By how much an explanation has to be better than none, in units of the dispersion of its cost."""
    knobs = [k for k in values if k.effect != TUNE]
    return tuning.search.beyond_doubt * len({k.term for k in knobs}) + tuning.search.per_knob * len(knobs)


def _grown(search: LawSearch, found: WithLaws, rng: np.random.Generator) -> WithLaws | None:
    """An explanation extended by convincing terms, one at a time; None where no term is added or dropped."""
    first = terms = _terms(found.values)
    for _ in range(search.settings.passes):
        more = _added(search, found.space, found.values, rng)
        if more is None or _terms(more.values) == terms:  # what was added is needless: it would be added again
            break
        found, terms = replace(more, laws={**found.laws, **more.laws}), _terms(more.values)
    return None if terms == first else _reshaped(search, found)


def _terms(values: Values) -> frozenset[Term]:
    return frozenset(k.term for k in values if k.effect != TUNE)


def _reshaped(search: LawSearch, found: WithLaws) -> WithLaws:
    """The laws in richer shapes where these fit better beyond doubt once all terms are there, and as the effects that
    they are equivalent to where they do not fit better beyond doubt."""
    laws = {t: law for t, law in found.laws.items() if any(k.term == t for k in found.values if is_law(k.effect))}
    if not any(law.richer or named_twin(law, found.space) is not None for law in laws.values()):
        return found
    problem = _problem(search, found.space, found.values)
    (fit,) = fit_all(problem, [found.values], search.settings.fit_steps, settings=search.tuning.fit)
    for term, law in laws.items():
        laws[term], problem, fit = _shaped(search, problem, law, fit)
    for term, law in tuple(laws.items()):
        named = _as_named(search, problem, law, fit)
        if named is not None:
            fit = named
            del laws[term]
    return _with_laws(search, problem.space, fit, laws)


def _as_named(search: LawSearch, problem: Problem, law: Proposal, fit: Fit) -> Fit | None:
    """The fit with the effect that is equivalent to a law in its place; None where there is none or the law, which has
    numbers of its own, fits better beyond doubt. They may have taken up what terms explain that came later."""
    tuning, space, rest = search.tuning, problem.space, without(fit.values, law.term)
    twin = named_twin(law, space)
    if twin is None or not _addable([twin], space, rest):
        return None
    (tried,) = fit_all(problem, [{**rest, **twin.start}], search.settings.fit_steps, settings=tuning.fit)
    spread = dispersion(fit, blocks_of(search.few, settings=tuning.fit))
    price = tuning.search.beyond_doubt + tuning.search.per_knob * (len(fit.values) - len(tried.values))
    return tried if tried.cost - fit.cost <= price * spread else None


def _added(search: LawSearch, space: Space, values: Values, rng: np.random.Generator) -> WithLaws | None:
    """The best law on top of the values, or effect in its place, less the effects that it makes needless; None where
    none is convincing."""
    of, few, tuning, settings = search.of, search.few, search.tuning, search.settings
    laws = {k.term for k in values if is_law(k.effect)}
    room = len(laws) < settings.most
    proposed = propose(of.data, of.scales, space.settings([values]), rng, tuning, settings) if room else ()
    waves = {t for t in space.candidates if t.effect == TORQUE_RIPPLE.name}
    named = ripples(few, of.scales, space, values, tuning, settings) if waves else ()
    fitted = [p for p in proposed if not waves or p.form != "harmonic"]  # a wave of the angle has a name
    twins = [twin for p in fitted if (twin := named_twin(p, space)) is not None]
    new = _addable([*(replaced(of.values, values) if laws else ()), *named, *twins, *fitted], space, values)
    if not new:
        return None
    space = replace(space, fixed={**space.fixed, **{k: v for p in new for k, v in p.fixed.items()}})
    problem = _problem(search, space, values)
    starts = [values, *({**values, **p.start} for p in new)]
    current, *fits = fit_all(problem, starts, settings.fit_steps, settings=tuning.fit)
    best = _cheapest(fits, new, search)
    if not _predicts(search, space, current.values, fits[best], rng):
        return None
    law, problem, fit = _best_shaped(search, problem, new, fits, best, lambda f: _predicts(
        search, space, current.values, f, rng
    ))  # fmt: skip
    fit = _needed(search, problem, fit)
    return _with_laws(search, problem.space, fit, {law.term: law} if is_law(law.term.effect) else {})


def _problem(search: LawSearch, space: Space, values: Values) -> Problem:
    """The windows that choose, on the longest steps that change little about these values."""
    of, tuning = search.of, search.tuning
    exact = _trusting(build_problem(search.few, space, of.sigma, settings=tuning.predict), of, tuning)
    return on_longer_steps(exact, of.scales, values, settings=tuning.predict)


def _with_laws(search: LawSearch, space: Space, fit: Fit, laws: Mapping[Term, Proposal]) -> WithLaws:
    """A fit with the fixed numbers of its own terms alone."""
    chosen = {k.term for k in fit.values if k.effect != TUNE}
    fixed = {k: v for k, v in space.fixed.items() if k.term in chosen}
    spread = dispersion(fit, blocks_of(search.few, settings=search.tuning.fit))
    return WithLaws(replace(space, fixed=fixed), fit.values, laws, fit.cost, spread)


def _best_shaped(
    search: LawSearch,
    problem: Problem,
    new: Sequence[Proposal],
    fits: Sequence[Fit],
    best: int,
    predicts: Callable[[Fit], bool],
) -> tuple[Proposal, Problem, Fit]:
    """The best term in its best shape. Where that is a named effect, a law that fits as well even in its simplest shape
    may do much better in a richer one; predicts: whether it does so where it was not fitted."""
    chosen = _shaped(search, problem, new[best], fits[best])
    rivals = [i for i, p in enumerate(new) if is_law(p.term.effect) and fits[i].cost < fits[best].cost and p.richer]
    if is_law(new[best].term.effect) or not rivals:
        return chosen
    k = min(rivals, key=lambda i: fits[i].cost)
    other = _shaped(search, problem, new[k], fits[k])
    both = [(law, fit) for law, _, fit in (chosen, other)]
    law_is_better = _cheapest([fit for _, fit in both], [law for law, _ in both], search) == 1
    return other if law_is_better and predicts(other[2]) else chosen


def _shaped(search: LawSearch, problem: Problem, law: Proposal, fit: Fit) -> tuple[Proposal, Problem, Fit]:
    """The law in a richer shape where that fits better beyond doubt: far from the optimum, the remainder suggests too
    simple a shape."""
    tuning, settings = search.tuning, search.settings
    found, where, most = law, problem, fit
    for i, other in enumerate(law.richer):
        space = replace(problem.space, fixed={**_fixed_elsewhere(problem.space, law.term), **other.fixed})
        begun = {**without(fit.values, law.term), **_on_knots(problem.space, fit.values, other)}
        known = PredictionCache(problem.data, space, own=problem.replays.own, change=problem.replays.change)
        reshaped = replace(problem, space=space, replays=known)
        (tried,) = fit_all(reshaped, [begun], settings.shape_steps, settings=tuning.fit)
        spread = dispersion(tried, blocks_of(search.few, settings=tuning.fit))
        price = tuning.search.beyond_doubt + tuning.search.per_knob * (len(tried.values) - len(most.values))
        if most.cost - tried.cost > price * spread:
            found, where, most = replace(other, richer=law.richer[i + 1 :]), reshaped, tried
    return found, where, most


def _fixed_elsewhere(space: Space, term: Term) -> Values:
    return {k: v for k, v in space.fixed.items() if k.term != term}


def _on_knots(space: Space, values: Values, law: Proposal) -> Values:
    """The free numbers with which a law of this shape goes through the present one's values at its knots."""
    now = {k.parameter: v for k, v in space.whole(values).items() if k.effect != TUNE and k.term == law.term}
    knots = [law.fixed[Knob(*law.term[:2], name)] for name in KNOTS[: len(law.start)]]
    level = np.asarray(curve(NUMPY, now, np.array(knots)))
    return dict(zip(law.start, [float(level[0]), *np.diff(level).tolist()], strict=True))


def _addable(proposed: Sequence[Proposal], space: Space, values: Values) -> list[Proposal]:
    """Those that may join the terms of an explanation, each term once."""
    terms = list(dict.fromkeys(k.term for k in values if k.effect != TUNE))
    first = {p.term: p for p in reversed(proposed)}
    return [p for t, p in first.items() if t not in terms and space.may_join(t, terms)][::-1]


def _cheapest(fits: Sequence[Fit], new: Sequence[Proposal], search: LawSearch) -> int:
    """The place of the cheapest fit; a law has to be better than a named effect beyond doubt."""
    tuning = search.tuning
    spread = dispersion(min(fits, key=lambda f: f.cost), blocks_of(search.few, settings=tuning.fit))
    price = [tuning.search.per_knob * len(p.start) + is_law(p.term.effect) * tuning.search.beyond_doubt for p in new]
    return int(np.argmin([f.cost + spread * x for f, x in zip(fits, price, strict=True)]))


def _predicts(search: LawSearch, space: Space, before: Values, law: Fit, rng: np.random.Generator) -> bool:
    """Whether a law on top of what was there before makes the gap smaller beyond doubt on folds that the fit does
    without: by some of the jackknife's standard errors over stretches of time, and by something that an engineer would
    see above the noise."""
    few, scales, tuning, settings = search.few, search.of.scales, search.tuning, search.settings
    error = few.y - predict(few, space.settings([before]))[0]
    trust = fit_trust(few, scales, error, settings=tuning.data)
    folded = expected_errors(few, space, law, settings=tuning.fit)
    squares = (np.nan_to_num(trust * per_window(few, scales, e)) for e in (error, folded))
    blocks = blocks_of(few, settings=tuning.fit)
    was, now = (np.bincount(blocks, weights=x) for x in squares)
    left = 1.0 - (now.sum() - now) / (was.sum() - was)  # without each stretch
    sigma = np.sqrt(np.var(left) * (len(left) - 1))
    gain = 1.0 - now.sum() / was.sum()
    noise = [np.nansum(per_window(few, scales, e)) for e in noise_errors(few, space.settings([law.values]), rng, 2)]
    seen = was.sum() - now.sum() > tuning.search.over_floor * np.mean(noise)
    return bool(seen and gain >= settings.worth and gain > settings.sure * sigma)


def _needed(search: LawSearch, problem: Problem, fit: Fit) -> Fit:
    """The fit without the named effects that are not beyond doubt beside the law, which they imitated."""
    tuning = search.tuning
    blocks = blocks_of(search.few, settings=tuning.fit)
    while named := [t for t in fit.terms if not is_law(t.effect)]:
        starts = [taken_up(fit.values, t, problem.space) for t in named]
        fewer = fit_all(problem, starts, search.settings.fit_steps, settings=tuning.fit)
        rises = [(f.cost - fit.cost) / dispersion(fit, blocks) for f in fewer]
        k = int(np.argmin(rises))
        if rises[k] >= tuning.search.beyond_doubt:
            return fit
        fit = fewer[k]
    return fit


def _trusting(problem: Problem, of: Unexplained, tuning: RemainderSettings) -> Problem:
    """The problem in which windows that are unlike the others under the explanation so far weigh less."""
    error = problem.data.y - problem.replays([of.values])[0]
    trust = fit_trust(problem.data, of.scales, error, settings=tuning.data)
    return problem if (trust == 1.0).all() else replace(problem, count=trust)
