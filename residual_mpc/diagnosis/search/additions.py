"""What may be added to a set of effects: screened, fitted roughly, and the best of it to the end."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np

from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, Race, fit_all, on_problem
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.optional_numbers import may_be_shown, misplaced, with_shown, without_nulls
from residual_mpc.diagnosis.search.screen import (
    compared_mask,
    gap_weights,
    glance,
    rankings,
    screen,
    smaller,
)
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Knob, Term, Values

NONE = frozenset[Knob]()  # no threshold is looked for anew

Ranked = TypeVar("Ranked")


class OfTerm(Protocol):
    """Something that is about one term."""

    @property
    def term(self) -> Term:
        """The term."""
        ...


RankedTerm = TypeVar("RankedTerm", bound=OfTerm)


def additions(problem: Problem, beam: list[Fit], blocks: np.ndarray, settings: SearchSettings) -> list[Fit]:
    """The best sets with one more term than a set of the beam, cheapest first; each set of terms once.

    Empty where not even a generous reading of the screening promises anything beyond doubt: no fit is spent on it then.
    """
    tuned = settings.additions
    starts: list[tuple[Fit, Values]] = []
    promised = 0.0
    eligible = problem.space.candidates
    for place, parent in enumerate(beam):
        candidates = tuple(c for c in eligible if problem.space.may_join(c, parent.terms))
        leads = (
            screen(problem, parent, candidates, settings=settings)
            if place == 0
            else glance(problem, parent, candidates, tuned.glance_from, settings=settings)
        )
        # precise encoders may outweigh the pose, and a channel whose cause is missing weighs least in the likelihood:
        # a third of the places each go by the likelihood, by what the gap compares and by the gap itself
        ranked = mixed(*rankings(leads))
        if place == 0 and len(beam) > 1:
            near = {lead.term for lead in ranked[: len(ranked) // tuned.promising]}.union(parent.terms)
            eligible = tuple(c for c in eligible if c in near)
        chosen = varied(ranked, settings=settings)[: settings.shortlist // (1 + place)]
        starts += [(parent, {**parent.values, **lead.start}) for lead in chosen]
        promised = max([promised, *(lead.gain / dispersion(parent, blocks) for lead in leads)])
    phi = dispersion(beam[0], blocks)
    small, weight = smaller(problem, beam[0], settings=settings)
    widened = _widened(small, beam[0], phi, weight, settings)
    if tuned.generous * promised < settings.beyond_doubt:
        starts = []
    if not starts and not widened:
        return []
    margin = tuned.hopeless * phi
    parents = {id(parent): on_problem(small, parent, settings=settings.fit) for parent in beam}
    begin = [parents[id(p)] for p, _ in starts]
    new = [frozenset(s).difference(p.knobs) for p, s in starts]
    first = in_turn(
        small, fit_all(small, [s for _, s in starts], 1, rough=True, near=begin, fresh=new, settings=settings.fit)
    )
    first = first[: settings.shortlist]
    rough = fit_all(
        small,
        [f.values for f in first],
        tuned.rough - 1,
        rough=True,
        near=first,
        fresh=[f.fresh for f in first],
        settings=settings.fit,
    )
    shown = with_shown(small, rough, phi, weight, settings)
    rough = [f if s is None else s for f, s in zip(rough, shown, strict=True)] + widened
    finalists = distinct(in_turn(small, rough))[: settings.finalists + (2 if len(beam) > 1 else 0)]
    fits = closer(
        problem,
        small,
        finalists,
        Race(margin / weight),
        Race(margin, early=tuned.early),
        settings=settings,
    )
    fits = without_nulls(problem, fits, settings)
    kept = (f for f in fits if possible(f.values) and not misplaced(problem.space, f))
    children = distinct(sorted(kept, key=lambda f: f.cost))
    return [on_problem(problem, children[0], settings=settings.fit), *children[1:]] if children else []


def _widened(small: Problem, parent: Fit, phi: float, weight: float, settings: SearchSettings) -> list[Fit]:
    """The set itself with optional numbers free that the runs may show; empty for most sets."""
    if not may_be_shown(small, parent):
        return []
    here = on_problem(small, parent, settings=settings.fit)
    (found,) = with_shown(small, [here], phi, weight, settings)
    return [] if found is None else [found]


def closer(
    problem: Problem,
    small: Problem,
    begun: list[Fit],
    on_part: Race,
    on_all: Race,
    most: int | None = None,
    near: Fit | None = None,
    *,
    settings: SearchSettings,
) -> list[Fit]:
    """What was begun on the thinned problem fitted there in at most so many steps, and the last steps on the whole;
    each race says what is left on the way. The order is kept, the Jacobians are rough. near: see `fit_all`, on the
    whole."""
    new = [f.fresh for f in begun]
    ends = fit_all(
        small, [f.values for f in begun], most, race=on_part, rough=True, near=begun, fresh=new, settings=settings.fit
    )
    by = [near] * len(ends)
    return fit_all(
        problem,
        [f.values for f in ends],
        settings.additions.rough,
        race=on_all,
        rough=True,
        near=by,
        fresh=new,
        settings=settings.fit,
    )


def in_turn(problem: Problem, fits: list[Fit]) -> list[Fit]:
    """Best first, by cost, by what the gap compares and by the gap in turn."""
    mask, size = compared_mask(problem), gap_weights(problem)
    squares = {id(f): f.r.ravel() ** 2 for f in fits}
    return mixed(
        sorted(fits, key=lambda f: f.cost),
        sorted(fits, key=lambda f: float(squares[id(f)][mask].sum())),
        sorted(fits, key=lambda f: float(size @ squares[id(f)])),
    )


def varied(leads: Sequence[RankedTerm], settings: SearchSettings) -> list[RankedTerm]:
    """The leads in their order, of each term only the first few: the doses of one effect that all do well would
    crowd out the next effect."""
    taken: dict[Term, int] = {}
    out = []
    for lead in leads:
        taken[lead.term] = taken.get(lead.term, 0) + 1
        if taken[lead.term] <= settings.additions.probes:
            out.append(lead)
    return out


def mixed(*rankings: list[Ranked]) -> list[Ranked]:
    """Rankings of the same things taken in turn, each thing once."""
    seen: dict[int, Ranked] = {}
    for places in zip(*rankings, strict=True):
        for item in places:
            seen.setdefault(id(item), item)
    return list(seen.values())


def distinct(fits: list[Fit]) -> list[Fit]:
    """The first fit of each set of terms."""
    seen: dict[frozenset[Term], Fit] = {}
    for f in fits:
        seen.setdefault(frozenset(f.terms), f)
    return list(seen.values())


def simplest_first(children: list[Fit], blocks: np.ndarray, settings: SearchSettings) -> list[Fit]:
    """Cheapest first, but of those that the data do not tell from the cheapest, the ones with fewer numbers first."""
    if len(children) < 2:
        return children
    reach = children[0].cost + settings.steps.alike * dispersion(children[0], blocks)
    near = [c for c in children if c.cost <= reach]
    return sorted(near, key=lambda c: (len(c.knobs), c.cost)) + [c for c in children if c.cost > reach]
