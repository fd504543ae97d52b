"""The groups of effects that these runs cannot tell apart, and which member of each stands in the explanation."""

from collections.abc import Sequence

from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup, EffectSet
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.close_rivals import Rival
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import ORDER
from residual_mpc.models.settings import TUNE, Values


def place(terms: EffectSet) -> tuple[int, int, bool, str]:
    """Order of a member: fewer terms first, then the contract's table, then one target before all, which claims less:
    where only one joint ever reaches its limit, nothing is known of the others'."""
    names = [t.target for t in terms]
    return (len(terms), min(ORDER[t.effect] for t in terms), None in names, "".join(n or "" for n in names))


def groups_of(rivals: Sequence[Rival]) -> tuple[ConfoundedGroup, ...]:
    """One group per replaced member: it, and what stands in for it. A pair's group that only repeats the groups of its
    members says nothing new and is left out."""
    members: dict[EffectSet, list[EffectSet]] = {}
    for r in rivals:
        if r.alike:
            members.setdefault(r.gone, []).append(r.came)
    single = {g[0]: {c[0] for c in came if len(c) == 1} | {g[0]} for g, came in members.items() if len(g) == 1}
    groups = []
    for gone, came in members.items():
        if len(gone) == 2:
            first, second = (single.get(t, {t}) for t in gone)
            came = [c for c in came if len(c) != 2 or not any(a in first and b in second for a, b in (c, c[::-1]))]
        if came:
            groups.append(tuple(sorted({gone, *came}, key=place)))
    return tuple(groups)


def with_first_members(
    problem: Problem,
    fit: Fit,
    rivals: Sequence[Rival],
    groups: Sequence[ConfoundedGroup],
    phi: float,
    settings: SearchSettings,
) -> Fit:
    """The fit in which the first member of each group, by the contract's table, stands where it takes one exchange.
    phi: dispersion of the fit."""
    for group in groups:
        first = group[0]
        if all(t in fit.terms for t in first):
            continue
        for r in sorted(rivals, key=lambda r: r.ratio):
            if r.alike and r.came == first and r.gone in group and all(t in fit.terms for t in r.gone):
                fit = _exchanged(problem, fit, r, phi, settings)
                break
    return fit


def _exchanged(problem: Problem, fit: Fit, rival: Rival, phi: float, settings: SearchSettings) -> Fit:
    """The fit with the rival's exchange. The rival was fitted beside the other members that the search found; where
    some of these have been exchanged since, the new set is fitted, and stands unless it fits worse than the rival."""
    kept = {k: v for k, v in fit.values.items() if k.effect == TUNE or k.term not in rival.gone}
    if all(k in rival.fit.values for k in kept):
        return rival.fit
    came: Values = {k: v for k, v in rival.fit.values.items() if k.effect != TUNE and k.term in rival.came}
    whole = {**kept, **came}
    # what every fit holds, from where the rival found it and from where the fit did
    starts = [{k: rival.fit.values.get(k, v) for k, v in whole.items()}, whole]
    both = min(fit_all(problem, starts, settings=settings.fit), key=lambda f: f.cost)
    worst = max(fit.cost, rival.fit.cost) + settings.steps.alike * phi
    return both if both.cost < worst else fit
