"""What may stand in for a member of a set, as values that a fit starts from."""

import numpy as np

from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.screen import ScreenedTerm, glance, smaller
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.substitutes import imitate
from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.equivalents import together
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term, Values

MASS = "mass"  # the parameter, kg
LATE: tuple[Quantity, ...] = ("command delay", "command lag", "reading delay", "reading lag")


def stand_ins(problem: Problem, rest: Fit, fit: Fit, gone: tuple[Term, ...], settings: SearchSettings) -> list[Values]:
    """What may stand in for the terms that are gone, with the values of the rest. rest: fit without them."""
    tuned, kept = settings.rivals, rest.terms
    candidates = tuple(c for c in problem.space.candidates if problem.space.may_join(c, kept))
    starts = _on_all(problem, rest, fit, gone, candidates)
    if len(gone) == 1:
        starts = _on_other_targets(problem, rest, fit, gone[0], candidates, settings=settings)
        twins = tuple(c for c in candidates if problem.space.are_twins(c, gone[0]))
        seen = {gone[0], *twins} | {k.term for s in starts for k in s if k.effect == gone[0].effect}
        starts += [s for twin in twins if _within(problem, s := _as_twin(problem, fit, gone[0], twin))]
        most = tuned.looked_at + len(starts)
        leads = glance(problem, rest, candidates, settings=settings)
        own = max((lead.gain for lead in leads if lead.term == gone[0]), default=0.0)
        for lead in leads:
            if lead.term not in seen and len(starts) < most and lead.gain > tuned.resembles * own:
                seen.add(lead.term)
                starts.append({**rest.values, **lead.start})
        imitators = (lead for lead in _imitators(leads, gone[0], tuned.resembles) if lead.term not in seen)
        starts += [{**rest.values, **(lead.closing or lead.start)} for lead in imitators]
        starts += _as_pair(problem, rest, fit, gone[0], candidates)
        starts += _as_late(problem, rest, fit, gone[0], candidates)
        starts += _as_heavy(problem, rest, fit, gone[0], candidates)
    elif _on_single_targets(problem, gone):
        starts += _of_the_robot(problem, rest, candidates, settings=settings)
    elif (word := interchangeable(gone)) is not None:
        rims = [c for c in candidates if BY_NAME[c.effect].interchangeable == word and c not in gone]
        for i, a in enumerate(rims):
            starts += [
                {**rest.values, **problem.space.probes(a)[-1], **problem.space.probes(b)[-1]}
                for b in rims[i + 1 :]
                if problem.space.may_join(b, (*kept, a))
            ]
    return starts


def interchangeable(terms: tuple[Term, ...]) -> str | None:
    """What these effects do alike, so that a pair of them does what another pair does; None where they do not. Without
    encoders gains, radius and mismatch scale the same two rims."""
    words = {BY_NAME[t.effect].interchangeable for t in terms}
    return words.pop() or None if len(words) == 1 else None


def _imitators(leads: list[ScreenedTerm], gone: Term, resembles: float) -> list[ScreenedTerm]:
    """Of each candidate that does nearly the same as a term, the lead that removes most of the squared gap, if that is
    more than the share `resembles` of what the term's own lead removes. Small differences may absorb most of its
    contribution, so that the screening's likelihood gain is small."""
    best: dict[Term, ScreenedTerm] = {}
    for lead in sorted(leads, key=lambda lead: -lead.gap):
        best.setdefault(lead.term, lead)
    own = best[gone].gap if gone in best else 0.0
    least = max(resembles * own, 0.0)
    return [lead for term, lead in best.items() if imitate(term, gone) and lead.gap > least]


def _on_all(
    problem: Problem, rest: Fit, fit: Fit, gone: tuple[Term, ...], candidates: tuple[Term, ...]
) -> list[Values]:
    """One effect on several targets as the same on all of them, with the middle of the numbers that were found."""
    all_alike = Term(gone[0].effect, None)
    if len(gone) < 2 or len({t.effect for t in gone}) > 1 or all_alike not in candidates:
        return []
    found = [{k.parameter: v for k, v in fit.values.items() if k.term == t} for t in gone]
    middle = {Knob(all_alike.effect, None, name): float(np.median([f[name] for f in found])) for name in found[0]}
    return [_with(problem, rest, middle)]


def _on_single_targets(problem: Problem, gone: tuple[Term, ...]) -> bool:
    """Whether these are one effect on several targets that cannot act on all alike, such as masses of links."""
    effects = {t.effect for t in gone}
    return len(gone) > 1 and len(effects) == 1 and not BY_NAME[gone[0].effect].null_target


def _of_the_robot(problem: Problem, rest: Fit, candidates: tuple[Term, ...], settings: SearchSettings) -> list[Values]:
    """What acts on the robot or on all its targets alike and resembles what is missing most: the masses of two links
    may stand for a payload, constant torques at two joints for a tilted base."""
    leads = glance(problem, rest, tuple(c for c in candidates if c.target is None), settings=settings)
    best: dict[Term, ScreenedTerm] = {}
    for lead in sorted(leads, key=lambda lead: -lead.gap):
        best.setdefault(lead.term, lead)
    near = [lead for lead in best.values() if lead.gap > 0.0][: settings.rivals.looked_at]
    return [{**rest.values, **(lead.closing or lead.start)} for lead in near]


def _as_pair(problem: Problem, rest: Fit, fit: Fit, gone: Term, candidates: tuple[Term, ...]) -> list[Values]:
    """An effect on one target as the several effects that do the same together, where there are such."""
    numbers = {k.parameter: v for k, v in fit.values.items() if k.term == gone}
    found: Values = {Knob(*knob): v for knob, v in together(gone.effect, gone.target, numbers).items()}
    return [_with(problem, rest, found)] if found and all(k.term in candidates for k in found) else []


def _as_late(problem: Problem, rest: Fit, fit: Fit, gone: Term, candidates: tuple[Term, ...]) -> list[Values]:
    """For a term that delays commands or readings, the other such effects with the same time: the screening's probe may
    be too far from it to resemble it."""
    late = [v for k, v in fit.values.items() if k.term == gone and _delays(k)]
    starts: list[Values] = []
    for other in candidates if len(late) == 1 else ():
        found = [k for k in problem.space.knobs(other) if _delays(k)]
        if len(found) == 1 and imitate(other, gone) and not problem.space.are_twins(other, gone):
            starts.append(_with(problem, rest, {found[0]: late[0]}))
    return starts


def _as_heavy(problem: Problem, rest: Fit, fit: Fit, gone: Term, candidates: tuple[Term, ...]) -> list[Values]:
    """For a term that adds a mass, what imitates it with the same mass: where torques drive the robot, predictions
    diverge from a probe that is too heavy, and its fit does not come back."""
    mass = next((v for k, v in fit.values.items() if k.term == gone and k.parameter == MASS), None)
    others = [t for t in candidates if t != gone and imitate(t, gone) and not problem.space.are_twins(t, gone)]
    knobs = [Knob(t.effect, t.target, MASS) for t in others]
    known = [k for k in knobs if k in problem.space.knobs(k.term) and problem.space.bounds(k)[0] < (mass or 0.0)]
    return [] if mass is None else [_with(problem, rest, {k: mass}) for k in known]


def _delays(knob: Knob) -> bool:
    """Whether a number is the time by which a command or a reading is late."""
    return BY_NAME[knob.effect].parameter(knob.parameter).quantity in LATE


def _on_other_targets(
    problem: Problem, rest: Fit, fit: Fit, gone: Term, candidates: tuple[Term, ...], settings: SearchSettings
) -> list[Values]:
    """The same effect with the numbers that were found, on one target alone in place of all (the two that do best), or
    on all in place of one: a probe need not come near what another target's fit has found."""
    others = [t for t in candidates if t.effect == gone.effect and (t.target is None) != (gone.target is None)]
    starts: list[Values] = []
    for t in others:
        found = {Knob(t.effect, t.target, k.parameter): v for k, v in fit.values.items() if k.term == gone}
        starts.append(_with(problem, rest, found))
    if len(starts) > settings.rivals.best:
        small, _ = smaller(problem, rest, settings=settings)
        costs = np.einsum("hwn,hwn->h", r := small.residuals(starts), r)
        starts = [starts[i] for i in np.argsort(costs)[: settings.rivals.best]]
    return starts


def _as_twin(problem: Problem, fit: Fit, gone: Term, twin: Term) -> Values:
    """The whole fit with the numbers of a term as those of one that no run here can tell from it."""
    return {
        Knob(twin.effect, twin.target, k.parameter, twin.changed) if k.term == gone else k: v
        for k, v in fit.values.items()
    }


def _within(problem: Problem, values: Values) -> bool:
    """Whether the values are within their bounds: commands may be logged late, and readings cannot come early."""
    bounds = ((v, *problem.space.bounds(k)) for k, v in values.items() if k.effect != TUNE)
    return all(low <= v <= high for v, low, high in bounds)


def _with(problem: Problem, rest: Fit, found: Values) -> Values:
    """The rest of a set, and numbers of another term as far as its bounds let them."""
    return {**rest.values, **{k: float(np.clip(v, *problem.space.bounds(k))) for k, v in found.items()}}
