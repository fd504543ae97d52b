"""Thresholds between the probes of an effect.

A threshold acts by comparison, so that the cost may be flat over most of its range and fall only near the true value: a
dead zone below what a joint bears is not felt, and one above it lets the joint fall. Neither a few doses nor
derivatives lead there.
"""

import math
from collections.abc import Sequence
from typing import Protocol

from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

FINEST = 1.15  # ratio of neighbouring doses below which a fit converges on its own
MOST = 3  # doses between two
OUTSIDE = 2.0  # ratio that is looked at beyond the last of the probes
LITTLE = 0.1  # of the norm of what is left: a dose that moves the prediction by less explains nothing yet


class Screened(Protocol):
    """What a probe promises: by how much the cost falls, how much of the squared gap goes, and how far the prediction
    moves."""

    @property
    def term(self) -> Term:
        """The candidate."""

    @property
    def start(self) -> Values:
        """The probe itself, where the effect has a threshold."""

    @property
    def gain(self) -> float:
        """Of the cost."""

    @property
    def gap(self) -> float:
        """Of the squared gap."""

    @property
    def reach(self) -> float:
        """Whitened norm."""


def between_probes(space: Space, leads: Sequence[Screened], cost: float) -> list[tuple[Term, Values]]:
    """Doses in geometric steps around the best probe of each threshold that removes something, and beyond the last one
    that moves the prediction little. cost: of what is left, in units of the leads."""
    by_term: dict[Term, list[Screened]] = {}
    for lead in leads:
        if threshold_of(lead.term) is not None:
            by_term.setdefault(lead.term, []).append(lead)
    return [
        (term, {**mine[0].start, knob: dose})
        for term, mine in by_term.items()
        for knob in (Knob(term.effect, term.target, threshold_of(term) or ""),)
        for dose in _doses(space, knob, mine, LITTLE * math.sqrt(cost))
    ]


def threshold_of(term: Term) -> str | None:
    """The name of the one number of an effect, if that is a threshold of which a ratio makes sense."""
    free = [p for p in BY_NAME[term.effect].parameters if not p.optional]
    return free[0].name if len(free) == 1 and free[0].threshold and free[0].reference != "extremes" else None


def _doses(space: Space, knob: Knob, leads: Sequence[Screened], little: float) -> list[float]:
    """The further doses of one threshold."""
    low, high = space.bounds(knob)
    known = sorted({lead.start[knob] for lead in leads})
    if not (0.0 < known[0] and math.isfinite(known[-1])):
        return []
    outwards = -1.0 if math.isinf(space.null(knob)) else 1.0  # where the effect becomes stronger
    ends = [low, *known, high]
    parts: dict[tuple[float, float], None] = {}
    for key in ("gain", "gap"):
        best = max(leads, key=lambda lead: float(getattr(lead, key)))
        if getattr(best, key) > 0.0:
            dose = best.start[knob]
            parts |= dict.fromkeys(((dose, _next(dose, ends, 1.0)), (_next(dose, ends, -1.0), dose)))
    still = [lead.start[knob] for lead in leads if lead.reach < little]
    if still:
        last = max(still, key=lambda dose: outwards * dose)
        beyond = _next(last, ends, outwards)
        parts[min(last, beyond), max(last, beyond)] = None
    return [dose for part in parts for dose in _steps(*part)]


def _next(dose: float, doses: Sequence[float], way: float) -> float:
    """The next dose above (way 1) or below (-1), at most `OUTSIDE` times as large or small; itself on a bound."""
    beyond = [d for d in doses if way * d > way * dose]
    if not beyond:
        return dose
    return min([*beyond, dose * OUTSIDE]) if way > 0.0 else max([*beyond, dose / OUTSIDE])


def _steps(low: float, high: float) -> list[float]:
    """Doses in geometric steps between two."""
    n = min(max(math.ceil(math.log(high / low) / math.log(FINEST)) - 1, 0), MOST)
    return [low * (high / low) ** (k / (n + 1)) for k in range(1, n + 1)]
