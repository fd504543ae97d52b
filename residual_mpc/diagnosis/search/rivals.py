"""Other sets that explain these runs as well: rivals with a probability, and the groups that cannot be told apart."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.fit.evidence import blocks_of, without_the_most_telling
from residual_mpc.diagnosis.fit.least_squares import Fit, Race, fit_all, on_problem
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup, EffectSet, without
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem, wider_start
from residual_mpc.diagnosis.search.acceptance import Ruler, squared_gaps
from residual_mpc.diagnosis.search.additions import NONE, closer
from residual_mpc.diagnosis.search.close_rivals import (
    Rival,
    are_twins,
    is_its_simple_case,
    too_close,
)
from residual_mpc.diagnosis.search.confounded_groups import groups_of, with_first_members
from residual_mpc.diagnosis.search.optional_numbers import with_shown
from residual_mpc.diagnosis.search.screen import smaller
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stand_ins import interchangeable, stand_ins
from residual_mpc.diagnosis.search.stepwise import Found
from residual_mpc.diagnosis.search.substitutes import counting_what_includes
from residual_mpc.diagnosis.search.visible_gaps import low_pass_for_another, told_over, with_gaps_seen, with_low_pass
from residual_mpc.models.settings import Knob, Term, Values

NO_RACE = Race(np.inf)  # every fit is carried on


@dataclass(frozen=True)
class Rivalry:
    """The chosen fit after swaps, its rivals, the confounded groups, and each
    candidate's share of the likelihood in the place that it competes for."""

    fit: Fit
    rivals: tuple[Rival, ...]
    groups: tuple[ConfoundedGroup, ...]
    shares: dict[Term, float]
    as_found: Fit  # before the first of a group was preferred

    def standing_for(self, member: EffectSet) -> Fit | None:
        """The fit in which a group's member stands; None for one that no fit here holds."""
        if all(t in self.as_found.terms for t in member):
            return self.as_found
        fits = sorted((r for r in self.rivals if r.alike and r.came == member), key=lambda r: r.ratio)
        return fits[0].fit if fits else None


def find_rivals(
    found: Found,
    most: int | None = None,
    prefer_first: bool = True,
    over: Sequence[Ruler] = (),
    *,
    settings: SearchSettings,
) -> Rivalry:
    """Replace each term (each pair of rim scales, and one effect on several targets) by what resembles it; swap, `most`
    times, where that is better. prefer_first: whether the first of a confounded group takes the chosen one's place.
    over: windows of other horizons, which tell apart what the found ones do not.
    """
    tuned = settings.rivals
    most = tuned.swaps if most is None else most
    fit, rivals = found.fit, list[Rival]()
    places, swaps = _places(fit), 0
    while places:
        here = _replacements(found.problem, fit, places.pop(), found.phi, settings=settings)
        here = with_gaps_seen(found, fit, here, settings=settings)
        same = too_close(found.problem, found.ruler, fit, here, settings=settings)
        # twins are equally likely: their likelihoods differ because each rounds the delay to time steps in its own way,
        # or because a fit of many numbers has not come to its end. One that fits far better still takes the place
        twins = [r.ratio >= tuned.better and are_twins(found.problem, r) for r in here]
        blocks = blocks_of(found.problem.data, settings=settings.fit)
        simple = [is_its_simple_case(fit, r, blocks, settings) for r in here]
        begun = [r.ratio >= tuned.better and _begun_otherwise(fit, r) for r in here]
        same = [any(reasons) for reasons in zip(same, twins, simple, begun, strict=True)]
        here = [replace(r, ratio=0.0, alike=True) if s else r for r, s in zip(here, same, strict=True)]
        here = told_over(found, fit, here, over, settings=settings)
        rivals += here
        better = min(here, key=lambda r: r.ratio, default=None)
        if better is not None and better.ratio < tuned.better and swaps < most:
            fit, rivals = on_problem(found.problem, better.fit, settings=settings.fit), []
            places, swaps = _places(fit), swaps + 1
    order = [(t,) for t in fit.terms] + _several(fit)
    rivals.sort(key=lambda r: order.index(r.gone))
    groups = groups_of(rivals)
    preferred = with_first_members(found.problem, fit, rivals, groups, found.phi, settings) if prefer_first else fit
    return Rivalry(preferred, tuple(rivals), groups, _shares(preferred, rivals), fit)


def holds_elsewhere(
    rivalry: Rivalry, met: tuple[Fit, ...], replays: PredictionCache, ruler: Ruler, settings: SearchSettings
) -> Fit | None:
    """The rival, or the set that the search came across, whose gap on these windows is far smaller than that of the
    chosen set, None where there is none, and where the chosen set leaves as little as the sensors can tell. A search
    sees few and short windows; a set that fits them by chance fails on the others."""
    tuned = settings.rivals
    fits = [rivalry.fit, *(r.fit for r in rivalry.rivals if r.ratio < tuned.far), *met]
    gaps = squared_gaps(replays, ruler.scales, fits, settings)
    least = float(gaps.min())
    near = np.flatnonzero(gaps <= least + max(tuned.visible * ruler.floor, tuned.share * least))
    best = min(near.tolist(), key=lambda i: (len(fits[i].knobs), gaps[i]))  # the simplest of those that do as well
    much = gaps[0] > ruler.much
    return fits[best] if much and gaps[best] < tuned.far_smaller * gaps[0] else None


def _places(fit: Fit) -> list[tuple[Term, ...]]:
    """What may be replaced, the surest first: what was added last is the likeliest to stand for something else, and
    once it is exchanged all the others are to be looked at again."""
    return _several(fit) + [(t,) for t in fit.terms]


def _several(fit: Fit) -> list[tuple[Term, ...]]:
    """What may be replaced together, each once."""
    return list(dict.fromkeys([*_rim_pairs(fit.terms), *_on_targets(fit.terms)]))


def _replacements(
    problem: Problem, fit: Fit, gone: tuple[Term, ...], phi: float, settings: SearchSettings
) -> list[Rival]:
    tuned = settings.rivals
    values = fit.values
    for t in gone:
        values = without(values, t)
    rest = fit_all(problem, [values], 4, near=[fit], fresh=[NONE], settings=settings.fit)[0]
    starts = stand_ins(problem, rest, fit, gone, settings=settings)
    out: dict[EffectSet, Rival] = {}
    for other in (f for f in _fits(problem, rest, fit, starts, phi, settings=settings) if possible(f.values)):
        came = tuple(t for t in other.terms if t not in rest.terms)
        difference, gain = _difference(problem, rest, fit, other, settings=settings)
        ratio = difference / phi + tuned.per_knob * (len(other.knobs) - len(fit.knobs))
        alike = ratio < settings.steps.alike and other.cost - fit.cost < tuned.parallel * gain
        if came not in out or ratio < out[came].ratio:  # from two starts
            out[came] = Rival(gone, came, other, ratio, alike)
    return [_without_needless(problem, fit, r, phi, settings) for r in out.values()]


def _without_needless(problem: Problem, fit: Fit, rival: Rival, phi: float, settings: SearchSettings) -> Rival:
    """The rival without the effects of the chosen set that it makes redundant, fitted to convergence, if that is
    better. A search that begins with the wrong effect compensates for it with others; with the right one they only add
    numbers that have to be found."""
    tuned = settings.rivals
    if rival.alike or not 0.0 < rival.ratio < tuned.leaner:
        return rival
    others = [t for t in rival.fit.terms if t not in rival.came]
    rows = [without(rival.fit.values, t) for t in others]
    costs = np.einsum("hwn,hwn->h", r := problem.residuals(rows), r) if rows else np.zeros(0)
    needless = [t for t, cost in zip(others, costs, strict=True) if cost - rival.fit.cost < settings.steps.needed * phi]
    if not needless:
        return rival
    values = rival.fit.values
    for t in needless:
        values = without(values, t)
    (leaner,) = fit_all(problem, [values], settings.steps.thorough_steps, settings=settings.fit)
    difference = _surviving(problem, fit, leaner, settings)
    ratio = difference / phi + tuned.per_knob * (len(leaner.knobs) - len(fit.knobs))
    if ratio >= rival.ratio:
        return rival
    return replace(rival, fit=leaner, ratio=ratio)


def _difference(problem: Problem, rest: Fit, fit: Fit, other: Fit, settings: SearchSettings) -> tuple[float, float]:
    """How much larger the cost of another fit is, beyond a single stretch, and how much the chosen one gains over the
    rest.

    Where one of the two has a low-pass of the readings, whose input at a window's start has to be reconstructed from
    the readings and their slope, the difference counts only if both have the same sign under either uncertainty of the
    start, that without a low-pass and, for both fits, that with it; the smaller of the two then counts.
    """
    difference, gain = _surviving(problem, fit, other, settings), rest.cost - fit.cost
    lagged = [f for f in (fit, other) if with_low_pass(f)]
    if len(lagged) != 1 or difference > settings.rivals.works * gain:
        return difference, gain
    wide = wider_start(problem, lagged[0].values, settings=settings.predict)
    values = [fit.values, other.values, rest.values]
    own, came, without_it = fit_all(wide, values, settings.rivals.wide_steps, settings=settings.fit)
    widely, gained = _surviving(wide, own, came, settings), without_it.cost - own.cost
    if difference * widely <= 0.0:
        return 0.0, gained
    return (widely, gained) if abs(widely) < abs(difference) else (difference, gain)


def _surviving(problem: Problem, fit: Fit, other: Fit, settings: SearchSettings) -> float:
    """How much larger the cost of another fit is without the stretch that says so most."""
    return without_the_most_telling(other.per_window - fit.per_window, blocks_of(problem.data, settings=settings.fit))


def _begun_otherwise(fit: Fit, rival: Rival) -> bool:
    """Whether the likelihood hardly tells a low-pass of the readings from an effect that imitates it: the remaining
    difference depends on how the input of the low-pass at the start of a window is reconstructed."""
    return rival.alike and low_pass_for_another(fit, rival)


def _fits(
    problem: Problem, rest: Fit, fit: Fit, starts: list[Values], phi: float, settings: SearchSettings
) -> list[Fit]:
    """The starts fitted: roughly on fewer windows, to the end those that come within reach of the chosen fit. The
    others are hopeless, and only their cost is wanted."""
    tuned = settings.rivals
    additions = settings.additions
    if not starts:
        return []
    small, weight = smaller(problem, rest, settings=settings)
    chosen = np.einsum("wn,wn->w", r := small.residuals([fit.values])[0], r)
    new = [frozenset(s).difference(rest.knobs) for s in starts]
    starts, beside = _beside_the_better_values(small, starts, rest, fit, settings)
    rough = fit_all(small, starts, additions.rough, rough=True, near=beside, fresh=new, settings=settings.fit)
    rough = _carried_on(small, starts, rough, new, settings)
    shown = with_shown(small, rough, phi, weight, settings)
    rough = [r if s is None else s for r, s in zip(rough, shown, strict=True)]
    margin, blocks = additions.early * tuned.far * phi / weight, blocks_of(small.data, settings=settings.fit)
    near = [r.cost - chosen.sum() < margin for r in rough]
    # a single stretch says that they are far: no race, which goes by the whole cost
    but_one = [without_the_most_telling(r.per_window - chosen, blocks) < margin for r in rough]
    on_part = Race(margin, float(chosen.sum()))
    on_all = Race(tuned.far * phi, fit.cost, additions.early)
    raced = [r for r, n in zip(rough, near, strict=True) if n]
    alone = [r for r, n, b in zip(rough, near, but_one, strict=True) if b and not n]
    left = [r.values for r, n, b in zip(rough, near, but_one, strict=True) if not (n or b)]
    ends = iter(closer(problem, small, raced, on_part, on_all, 4, rest, settings=settings))
    freely = iter(closer(problem, small, alone, NO_RACE, NO_RACE, 4, rest, settings=settings))
    as_they_are = iter(fit_all(problem, left, 0, rough=True, settings=settings.fit))
    fits = [next(ends if n else freely if b else as_they_are) for n, b in zip(near, but_one, strict=True)]
    return _with_numbers(problem, fits, fit, phi, settings)


def _with_numbers(problem: Problem, fits: list[Fit], fit: Fit, phi: float, settings: SearchSettings) -> list[Fit]:
    """The fits, those within reach of the chosen one with the optional numbers that only all windows show."""
    within = [i for i, f in enumerate(fits) if f.cost - fit.cost < settings.rivals.leaner * phi]
    shown = with_shown(problem, [fits[i] for i in within], phi, 1.0, settings)
    begun = [(i, s) for i, s in zip(within, shown, strict=True) if s is not None]
    steps = settings.steps.thorough_steps
    found = fit_all(problem, [s.values for _, s in begun], steps, settings=settings.fit) if begun else []
    by_place = {i: f for (i, _), f in zip(begun, found, strict=True) if possible(f.values)}
    return [by_place.get(i, f) for i, f in enumerate(fits)]


def _beside_the_better_values(
    small: Problem, starts: list[Values], rest: Fit, fit: Fit, settings: SearchSettings
) -> tuple[list[Values], list[Fit]]:
    """Each start, with what the set keeps as the fit without the replaced term has it or as the chosen fit has it,
    whichever leaves less, and that fit. Without a term that explains most, a fit moves all others far away."""
    kept = {k: v for k, v in fit.values.items() if k in rest.values}
    others = [{**s, **kept} for s in starts]
    costs = np.einsum("hwn,hwn->h", r := small.residuals([*starts, *others]), r)
    chosen = costs[len(starts) :] < costs[: len(starts)]
    here = {c: on_problem(small, fit if c else rest, settings=settings.fit) for c in set(chosen.tolist())}
    return [b if c else a for a, b, c in zip(starts, others, chosen, strict=True)], [here[c] for c in chosen.tolist()]


def _carried_on(
    small: Problem, starts: list[Values], rough: list[Fit], new: list[frozenset[Knob]], settings: SearchSettings
) -> list[Fit]:
    """The rough fits, of which those whose cost has fallen to a small share of what it was go on as many steps again: a
    start that is far from its minimum is on its way there, not hopeless."""
    begun = np.einsum("hwn,hwn->h", r := small.residuals(starts), r)
    going = [i for i, f in enumerate(rough) if f.cost < settings.rivals.falling * begun[i]]
    if not going:
        return rough
    further = fit_all(
        small,
        [rough[i].values for i in going],
        settings.additions.rough,
        rough=True,
        fresh=[new[i] for i in going],
        settings=settings.fit,
    )
    by_place = dict(zip(going, further, strict=True))
    return [by_place.get(i, f) for i, f in enumerate(rough)]


def _rim_pairs(terms: tuple[Term, ...]) -> list[tuple[Term, ...]]:
    return [(a, b) for i, a in enumerate(terms) for b in terms[i + 1 :] if interchangeable((a, b)) is not None]


def _on_targets(terms: tuple[Term, ...]) -> list[tuple[Term, ...]]:
    """The terms of each effect that stands on several targets."""
    by_effect: dict[str, list[Term]] = {}
    for t in terms:
        by_effect.setdefault(t.effect, []).append(t)
    return [tuple(ts) for ts in by_effect.values() if len(ts) > 1]


def _shares(fit: Fit, rivals: list[Rival]) -> dict[Term, float]:
    """Likelihood weights of each chosen term and of all that could stand in its place."""
    shares: dict[Term, float] = {}
    for term in fit.terms:
        # a member of a group that was preferred to the one that was found competes for that one's place
        came = [r for r in rivals if r.came == (term,)]
        preferred = came and not any(r.gone == (term,) for r in rivals)
        place_of = min(came, key=lambda r: r.ratio).gone if preferred else (term,)
        weights: dict[EffectSet, float] = {place_of: 1.0}
        both = {term, *place_of}
        for r in rivals:
            needless = both.isdisjoint(r.gone) and both.isdisjoint(r.fit.terms)  # another term's rival does without it
            if r.gone == place_of or needless:
                weight = float(np.exp(-0.5 * np.clip(r.ratio, 0.0, 200.0)))
                weights[r.came] = max(weights.get(r.came, 0.0), weight)
        total = sum(weights.values())
        alike = {place_of, *(r.came for r in rivals if r.gone == place_of and r.alike)}
        alone = {members[0]: weight for members, weight in weights.items() if len(members) == 1}
        for t, weight in counting_what_includes(alone, {m[0] for m in alike if len(m) == 1}).items():
            shares[t] = max(shares.get(t, 0.0), weight / total)
    return shares
