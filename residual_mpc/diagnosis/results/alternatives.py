"""The explanations that were compared, as the document lists them: candidates, whole sets, alternatives."""

from collections.abc import Collection, Mapping

import numpy as np

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.effect_sets import ConfoundedGroup, EffectSet
from residual_mpc.diagnosis.results.records import Alternative, Candidate, RivalSet
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.search.close_rivals import Rival
from residual_mpc.diagnosis.search.rivals import Rivalry
from residual_mpc.models.settings import TUNE, Term, Values

LISTED = 6  # sets that are listed as wholes


def candidates(
    rivalry: Rivalry,
    base: Fit,
    final: Fit,
    sure: Mapping[Term, float],
    left_out: tuple[Term, ...],
    doubt: Mapping[Term, float],
) -> tuple[Candidate, ...]:
    """Every term that was seriously compared, with its probability and what the fit with it leaves; sure: what each
    named effect, or another in its place, gets without a rival; left_out: what the search had found and a later look
    refuted; doubt: factors on the named effects' probabilities."""
    least = min(sure.values(), default=0.0)
    in_place = dict(sure)
    costs: dict[Term, float] = dict.fromkeys(final.terms, final.cost)
    for r in rivalry.rivals:
        for t in r.came:
            costs.setdefault(t, r.fit.cost * final.cost / max(rivalry.fit.cost, 1e-12))
            in_place.setdefault(t, min(sure.get(g, least) for g in r.gone))
    for t in rivalry.shares:  # what a group's first member took the place of
        costs.setdefault(t, final.cost)
    shares = {t: s for t, s in rivalry.shares.items() if t not in left_out}
    out = [
        Candidate(
            t,
            in_place.get(t, least) * shares.get(t, 0.0) * doubt.get(t, 1.0),
            float(1.0 - np.sqrt(max(c, 0.0) / max(base.cost, 1e-12))),
        )
        for t, c in costs.items()
    ]
    return tuple(sorted(out, key=lambda c: -c.probability))


def rival_sets(rivalry: Rivalry, gone: Collection[Term] = ()) -> tuple[RivalSet, ...]:
    """The best few sets as wholes, the chosen one among them, with the share of the likelihood that each holds. Members
    of several groups stand in any combination, with the product of their weights. gone: effects that are left out of
    all of them, with the others of their groups: the search may have found another member."""
    lost = set(gone)
    for members in ({*r.gone, *r.came} for r in rivalry.rivals if r.alike):
        if lost & members:
            lost |= members

    def less(terms: EffectSet) -> EffectSet:
        return tuple(t for t in terms if t not in lost)

    found, rivals = less(rivalry.as_found.terms), [r for r in rivalry.rivals if not lost & {*r.gone, *r.came}]
    weights: dict[EffectSet, float] = {found: 1.0}
    for r in rivals:
        weights[less(r.fit.terms)] = max(weights.get(less(r.fit.terms), 0.0), _weight(r))
    several: dict[EffectSet, float] = {found: 1.0}
    for r in (r for r in rivals if r.alike):
        several |= {_exchanged(terms, r): w * _weight(r) for terms, w in several.items() if _has_place(terms, r)}
    known = {frozenset(terms) for terms in weights}
    weights |= {terms: w for terms, w in several.items() if frozenset(terms) not in known}
    total = sum(weights.values())
    ranked = sorted((RivalSet(t, w / total) for t, w in weights.items()), key=lambda r: -r.probability)
    return tuple(ranked[:LISTED])


def _weight(rival: Rival) -> float:
    return float(np.exp(-0.5 * np.clip(rival.ratio, 0.0, 200.0)))


def _has_place(terms: EffectSet, rival: Rival) -> bool:
    """Whether a set has what a rival replaces, and not what comes in its place."""
    return set(rival.gone) <= set(terms) and not set(rival.came) & set(terms)


def _exchanged(terms: EffectSet, rival: Rival) -> EffectSet:
    return (*rival.came, *(t for t in terms if t not in rival.gone))


def alternatives(
    rivalry: Rivalry, groups: tuple[ConfoundedGroup, ...], final: Fit, settings: ResultSettings
) -> tuple[Alternative, ...]:
    """The other members of the groups, each with the values of the whole in which it stands; then the closest rivals
    that are not beyond doubt worse."""
    out: dict[EffectSet, Alternative] = {}
    for group in groups:
        here = next((m for m in group if all(t in final.terms for t in m)), ())
        for member in group:
            fit = rivalry.standing_for(member)
            if fit is not None and member != here and not all(t in final.terms for t in member):
                ratio = min((r.ratio for r in rivalry.rivals if r.came == member), default=0.0)
                out[member] = Alternative(member, here, _beside_named(fit, final, member, here, groups), ratio, True)
    close = (r for r in rivalry.rivals if not r.alike and r.ratio < settings.search.beyond_doubt)
    for r in sorted(close, key=lambda r: r.ratio)[: settings.closest]:
        if r.came and r.came not in out and all(t in final.terms for t in r.gone):
            values = _beside_named(r.fit, final, r.came, r.gone, groups)
            out[r.came] = Alternative(r.came, r.gone, values, r.ratio, False)
    return tuple(out.values())


def _beside_named(
    fit: Fit, final: Fit, came: EffectSet, gone: EffectSet, groups: tuple[ConfoundedGroup, ...]
) -> Values:
    """The values of a rival, in which the named members of the other groups stand: it was fitted beside what the search
    had found, which may have been other members of these groups."""
    values = dict(fit.values)
    for group in groups:
        named = next((m for m in group if all(t in final.terms for t in m)), ())
        beside = [m for m in group if m != named and all(t in fit.terms for t in m)]
        for member in beside:
            if named and named != gone and not set(member) & {*came, *final.terms}:
                values = {k: v for k, v in values.items() if k.effect == TUNE or k.term not in member}
                values |= {k: v for k, v in final.values.items() if k.effect != TUNE and k.term in named}
    return values
