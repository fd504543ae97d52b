"""The hypotheses of a comparison: effects that act on the later runs alone, on top of what acts on both sets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.effect import Parameter
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Settings, Term, Values

LARGEST_RATIO = 20.0  # by which a factor may change
FEW = 3  # probes of a change
NONE: Mapping[tuple[str, str], float] = {}

Limits = Mapping[Knob, tuple[float, float]]


@dataclass(frozen=True)
class ChangeSpace(Space):
    """A space in which terms may be changes: what is added to a number, or multiplies it, on the later runs. earlier,
    later_on: limits of each number that hold for every nominal model of a set: the two may have different ones."""

    earlier: Limits
    later_on: Limits

    def knobs(self, term: Term) -> tuple[Knob, ...]:
        """The free numbers of a term."""
        return tuple(k._replace(changed=term.changed) for k in super().knobs(term))

    def bounds(self, knob: Knob) -> tuple[float, float]:
        """Limits of a free number; those of a change let the changed number reach any of its own."""
        if not knob.changed:
            return self.earlier.get(knob) or super().bounds(knob)
        low, high = self.later_bounds(knob._replace(changed=False))
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        if p.shape or not np.isfinite(p.null):
            return low, high
        if p.null == 1.0:
            return max(low / max(high, 1.0), 1.0 / LARGEST_RATIO), LARGEST_RATIO
        return min(low, -high), max(high, -low)

    def later_bounds(self, knob: Knob) -> tuple[float, float]:
        """Limits of a number on the later runs."""
        return self.later_on.get(knob) or Space.bounds(self, knob)

    def probes(self, term: Term) -> list[Values]:
        """Values worth a first look; of a change no more than tell its direction, since its size, which may be
        negative, follows from the units."""
        there = super().probes(term)
        if not term.changed:
            return there
        there = [{k._replace(changed=True): v for k, v in probe.items()} for probe in there]
        (first, *others) = (p for p in BY_NAME[term.effect].parameters if not p.shape)
        if others or len(there) <= FEW:
            return there
        knob = Knob(term.effect, term.target, first.name, True)
        values = sorted(((probe[knob], i) for i, probe in enumerate(there)), key=lambda v: v[0])
        if np.isfinite(first.null) and not first.threshold:
            below = [v for v in values if v[0] < first.null][-1:]
            above = [v for v in values if v[0] > first.null]
            chosen = [*below, *above[:1], *above[1:][-1:]]
        else:
            own = self.reached_limit(term) or np.inf  # limits beyond it raise that of the model
            lower = [v for v in values if v[0] <= own]
            chosen = [lower[0], lower[len(lower) // 2], lower[-1], *values[len(lower) :][-1:]]
        return [there[i] for _, i in chosen]

    def settings(self, hypotheses: Sequence[Values]) -> Settings:
        """One row per hypothesis, with the values on the later runs beside those on the earlier ones."""
        earlier = [{k: v for k, v in h.items() if not k.changed} for h in hypotheses]
        before = super().settings(earlier)
        if all(len(e) == len(h) for e, h in zip(earlier, hypotheses, strict=True)):
            return before
        return replace(before, others=(super().settings([self.later(h) for h in hypotheses]),))

    def later(self, values: Values) -> Values:
        """The values on the later runs: each change composed with what acts on both sets, target by target."""
        out = {k: v for k, v in values.items() if not k.changed}
        for knob in (k for k in values if k.changed):
            for target in self._targets(knob, out):
                own = Knob(knob.effect, target, knob.parameter)
                general = Knob(knob.effect, None, knob.parameter)
                p = BY_NAME[knob.effect].parameter(knob.parameter)
                before = out.get(own, out.get(general))
                composed = values[knob] if before is None else compose(p, before, values[knob])
                out[own] = float(np.clip(composed, *self.later_bounds(own)))
        return out

    def _targets(self, knob: Knob, values: Values) -> list[str | None]:
        """Where a change acts: on its target, and where that is none on each target that has a value of its own."""
        if knob.target is not None:
            return [knob.target]
        own = [k.target for k in values if (k.effect, k.parameter) == (knob.effect, knob.parameter)]
        return [*(t for t in own if t is not None), None]


def compose(p: Parameter, before: float, change: float) -> float:
    """A number after a change: a factor multiplies, limits take the lower one, springs act in series, all else adds; a
    number that says only how an effect acts stays."""
    if p.shape:
        return before
    if not np.isfinite(p.null):
        if not np.isfinite(before):
            return change
        return min(before, change) if p.threshold else 1.0 / (1.0 / before + 1.0 / change)
    return before * change if p.null == 1.0 else before + change


def change_between(p: Parameter, before: float, after: float) -> float:
    """The size of a change: the ratio of factors, the difference of all else; of a limit or spring that was not there
    before, what it is."""
    if not np.isfinite(p.null):
        return after if not np.isfinite(before) else after / before
    return after / before if p.null == 1.0 else after - before


def change_space(
    space: Space,
    earlier: Sequence[Robot] = (),
    later: Sequence[Robot] = (),
    later_ends: Mapping[tuple[str, str], float] = NONE,
) -> ChangeSpace:
    """The same references, with a change of every candidate in place of the candidates; earlier, later: the nominal
    models of the two sets, whose limits hold; later_ends: how far the joints go in the later set, beyond which a new
    stop may be (see `ends_of`)."""
    return ChangeSpace(
        space.robot,
        space.slots,
        tuple(t._replace(changed=True) for t in space.candidates),
        space.tunables,
        {**space.references, **later_ends},
        {t._replace(changed=True): why for t, why in space.ruled_out.items()},
        _limits(space, earlier),
        _limits(space, later),
        twins=space.twins,
    )


def _limits(space: Space, robots: Sequence[Robot]) -> Limits:
    """The limits of every number that hold for all of these robots; none where there are no robots."""
    distinct = list({id(r): r for r in robots}.values())
    out: dict[Knob, tuple[float, float]] = {}
    terms = dict.fromkeys(t for c in space.candidates for t in (c, c._replace(target=None)))
    for term in terms if distinct else ():
        for knob in space.knobs(term):
            each = [replace(space, robot=r).bounds(knob) for r in distinct]
            out[knob] = max(low for low, _ in each), min(high for _, high in each)
    return out
