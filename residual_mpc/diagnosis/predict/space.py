"""The free numbers of the candidate effects of one robot on these runs: scales, bounds and first looks."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np

from residual_mpc.diagnosis.predict.reached_limits import MOST_RAISED, PROBED, reached_limit
from residual_mpc.diagnosis.predict.references import BETWEEN, GIVEN, HIGHEST, LOWEST, RUN, middle_of, turned_of
from residual_mpc.effects.body import USUAL_SIZES
from residual_mpc.effects.library import BY_NAME, holder
from residual_mpc.effects.position_servo import POSITION_GAIN
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Knob, Settings, Term, Values, assemble

FAR_MORE = 2.0  # times the torque that a model needs, from which what the motors give is probed as friction
RUBBING = ("damping", "frictionloss")  # nominal numbers of a joint that may act on either side of its gear
TURNED = 0.2  # rad over the whole range of a joint: what a typical step of a number of cycles changes


@dataclass(frozen=True)
class Space:
    """References measured on the runs, and the robot whose limits hold.

    references[kind, slot]: a typical "command", "output" or "torque" of a slot, in its unit.
    """

    robot: Robot
    slots: Mapping[str, tuple[str, ...]]
    candidates: tuple[Term, ...]
    tunables: tuple[Knob, ...]
    references: Mapping[tuple[str, str], float]
    ruled_out: Mapping[Term, str]  # terms that no run here can show, and why
    # numbers of fitted laws that say how they act, which no fit changes
    fixed: Values = field(default_factory=dict, kw_only=True)
    # values worth a first look that what is left suggests, of the effects that are looked at nowhere else
    suggested: Mapping[Term, tuple[Values, ...]] = field(default_factory=dict, kw_only=True)
    twins: tuple[frozenset[Term], ...] = field(default=(), kw_only=True)  # pairs that no run here can tell apart

    def may_join(self, term: Term, terms: Sequence[Term]) -> bool:
        """Whether a term may join others: not twice the same, never an effect both on all targets and on one, and not
        beside what the runs cannot tell from it."""
        return not any(
            self.are_twins(t, term) if t.effect != term.effect else t.target is None or term.target is None or t == term
            for t in terms
        )

    def are_twins(self, one: Term, other: Term) -> bool:
        """Whether no run here can tell these terms apart, both of both sets of runs or both changes."""
        if one.changed != other.changed:
            return False
        return frozenset({one._replace(changed=False), other._replace(changed=False)}) in self.twins

    def knobs(self, term: Term) -> tuple[Knob, ...]:
        """The free numbers of a term, less those that stay at their null value unless the runs show them."""
        every = (Knob(term.effect, term.target, p.name) for p in BY_NAME[term.effect].parameters if not p.optional)
        return tuple(k for k in every if k not in self.fixed)

    def optional(self, term: Term) -> tuple[Knob, ...]:
        """The numbers of a term that stay at their null value unless the runs show them."""
        return tuple(
            Knob(term.effect, term.target, p.name, term.changed)
            for p in BY_NAME[term.effect].parameters
            if p.optional
            and (p.quantity != "damping behind the gear" or self._damped(term))
            and (p.quantity != "ripple lead" or self._servoed(term))
        )

    def _damped(self, term: Term) -> bool:
        """Whether the model has friction at the joint of a gear, or at any where the term acts on all."""
        joints = dict(zip(self.robot.actuators, optional.actuator_joints(self.robot), strict=True))
        slots = self._slots(term)
        nominal = self.robot.nominal()
        return any(nominal.get(f"joint.{joints.get(s, s)}.{x}", 0.0) > 0.0 for s in slots for x in RUBBING)

    def _servoed(self, term: Term) -> bool:
        """Whether a position servo with damping drives the joint of a term, or one of its joints."""
        joints = dict(zip(self.robot.actuators, optional.actuator_joints(self.robot), strict=True))
        slots = self._slots(term)
        return any(joints[a] in slots for a in self.robot.slots(POSITION_GAIN.name))

    def _slots(self, of: Knob | Term) -> tuple[str, ...]:
        """The targets on which a number or a term acts."""
        return self.slots[of.effect] if of.target is None else (of.target,)

    def whole(self, values: Values) -> Values:
        """The values with the fixed numbers of the laws among them."""
        terms = {k.term for k in values if k.effect != TUNE} if self.fixed else set()
        return {**{k: v for k, v in self.fixed.items() if k.term in terms}, **values}

    def reference(self, knob: Knob) -> float:
        """What one unit of a parameter's `probes` is worth here."""
        if knob.effect == TUNE:
            return abs(self.robot.nominal()[knob.parameter]) or self._usual(knob.parameter)
        kind = BY_NAME[knob.effect].parameter(knob.parameter).reference
        if kind == "one":
            return 1.0
        slots = self._slots(knob)
        if kind == "reach":
            return (self.turned(knob) or 1.0) if slots and set(slots) <= optional.sliding(self.robot) else 1.0
        if kind == "extremes":
            ends = [[self.references.get((end, s), x) for s in slots] for end, x in ((HIGHEST, 1.0), (LOWEST, -1.0))]
            return float(np.median(ends[0]) - np.median(ends[1]))
        if kind == "1/run":
            return self.references.get(RUN, 1.0)
        if kind == "1/torque":
            return 1.0 / float(np.median([self.references.get(("torque", s), 1.0) for s in slots]))
        if kind in ("inertia", "mass", "length", "play"):
            return float(np.median([self.robot.reference(kind, s) for s in slots]))
        return float(np.median([self.references.get((kind, s), 1.0) for s in slots]))

    def _usual(self, name: str) -> float:
        """A tenth of what matters at its joint, for a nominal number that is 0: a URDF states no rotor's inertia, and a
        step in proportion to nothing leads nowhere."""
        of, _, rest = name.partition(".")
        joint, _, what = rest.rpartition(".")
        kind = USUAL_SIZES.get(what) if of == "joint" and joint in optional.joints(self.robot) else None
        if kind is None:
            return 1e-6
        known = self.references.get((kind, joint))
        return 0.1 * (self.robot.reference(kind, joint) if known is None else known)

    @property
    def rough(self) -> bool:
        """Whether predictions jump as a number changes."""
        return optional.rough(self.robot)

    def scale(self, knob: Knob) -> float:
        """A typical step of a free number: its smallest non-null probe's distance from null."""
        if knob.effect == TUNE:
            return 0.3 * self.reference(knob)
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        reference = self.reference(knob)
        null = 0.0 if math.isinf(p.null) else p.null
        away = [abs(x * reference - (null if p.reference == "one" else 0.0)) for x in p.probes]
        away = [x for x in away if x > 0]
        if p.reference in ("output", "turn"):
            return 0.1 * reference
        if p.reference == "extremes":
            return 0.03 * reference
        if p.cover:
            return TURNED / max(self.turned(knob), 1e-3)
        return min(away) if away else 0.02 * max(1.0, self.robot.reference("length", None))

    def bounds(self, knob: Knob) -> tuple[float, float]:
        """Limits of a free number, the effect's and the robot's."""
        if knob.effect == TUNE:
            return 0.0, np.inf
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        low, high = self.robot.bounds(knob.effect, knob.parameter, knob.target)
        if math.isfinite(p.most):
            reach = p.most * self._largest(p.reference, knob)
            high = min(high, reach)
            low = max(low, -reach) if p.lower < p.null else low
        high = max(high, MOST_RAISED * self.reached_limit(knob.term))
        if p.quantity == "command delay":
            low = max(low, -0.5 * self.references.get(BETWEEN, 0.0) if knob.target is None else 0.0)
        if p.quantity == "viscous damping":
            high = min(high, self._most_damping(knob))
        if p.within is not None:
            reach = self.robot.reference(p.within, None)
            low, high = max(low, -reach), min(high, reach)
        if p.cover:
            low = max(low, min(p.cover * 2.0 * np.pi / max(self.turned(knob), 1e-9), p.upper))
        return max(p.lower, low), min(p.upper, high)

    def turned(self, knob: Knob) -> float:
        """rad through which a joint turns in the runs, the one of a term's slots that turns most."""
        slots = self._slots(knob)
        return max(turned_of(self.references, s) for s in slots)

    def probes(self, term: Term) -> list[Values]:
        """Values worth a first look in a search."""
        if BY_NAME[term.effect].proposed:
            return list(self.suggested.get(term, ()))
        doses = self.plausible(term)
        for knob in self.optional(term):
            tried = BY_NAME[term.effect].parameter(knob.parameter).tried
            if tried is not None:
                doses += [{**dose, knob: tried} for dose in doses]
        return doses

    def plausible(self, term: Term) -> list[Values]:
        """Doses that an effect may well have."""
        effect = BY_NAME[term.effect]
        columns = []
        for p in (p for p in effect.parameters if not p.optional):
            knob = Knob(term.effect, term.target, p.name)
            low, high = self.bounds(knob)
            columns.append([float(np.clip(self._probe(knob, x), low, high)) for x in p.probes])
        knobs = self.knobs(term)
        rows = zip_longest(*columns)
        doses = [{k: (c[-1] if x is None else x) for k, x, c in zip(knobs, row, columns, strict=True)} for row in rows]
        return doses + self._stalling(term, doses[-1]) + self._raised(term)

    def reached_limit(self, term: Term) -> float:
        """The model's limit of forces that the term may raise, see `reached_limits`; 0 where there is none."""
        if BY_NAME[term.effect].site != "limit":
            return 0.0
        slots = self._slots(term)
        return reached_limit(self.robot, self.references, slots)

    def _raised(self, term: Term) -> list[Values]:
        """Limits beyond that of the model, if it reaches its own; empty for other effects."""
        own = self.reached_limit(term)
        return [dict.fromkeys(self.knobs(term), x * own) for x in PROBED] if own else []

    def _stalling(self, term: Term, largest: Values) -> list[Values]:
        """A dry friction that takes what the motors give at the measured states, where that is far more than the model
        needs for these motions; empty for other effects and robots. The other doses lie too far below it."""
        if BY_NAME[term.effect].parameters[0].quantity != "dry friction":
            return []
        slots = self._slots(term)
        given, needed = (max(self.references.get((kind, s), 0.0) for s in slots) for kind in (GIVEN, "torque"))
        if given < FAR_MORE * needed:
            return []
        of_torque = {p.name for p in BY_NAME[term.effect].parameters if p.reference == "torque"}
        times = given / max(largest[self.knobs(term)[0]], 1e-12)
        scaled = {k: v * times if k.parameter in of_torque else v for k, v in largest.items()}
        return [{k: float(np.clip(v, *self.bounds(k))) for k, v in scaled.items()}]

    def _probe(self, knob: Knob, x: float) -> float:
        """The value that a probe x stands for."""
        kind = BY_NAME[knob.effect].parameter(knob.parameter).reference
        slots = self._slots(knob)
        if kind == "reach":
            middles = [middle_of(self.references, s) for s in slots]
            return x * self.reference(knob) + float(np.median(middles))
        if kind != "extremes":
            return x * self.reference(knob)
        end = HIGHEST if x > 0 else LOWEST
        return float(np.median([self.references.get((end, s), x) for s in slots]))

    def null(self, knob: Knob) -> float:
        """The value at which a free number does nothing (the nominal value of a tunable one)."""
        if knob.effect == TUNE:
            return float(self.robot.nominal()[knob.parameter])
        return BY_NAME[knob.effect].parameter(knob.parameter).null

    def settings(self, hypotheses: Sequence[Values]) -> Settings:
        """One row per hypothesis; a tunable parameter that it does not name keeps its nominal value."""
        hypotheses = [self.whole(h) for h in hypotheses]
        named = {k for h in hypotheses for k in h}
        nominal = {k: self.null(k) for k in self.tunables if k in named}
        return assemble([{**nominal, **h} for h in hypotheses] if nominal else hypotheses, self.slots)

    def _most_damping(self, knob: Knob) -> float:
        """N m s/rad with which a joint at its typical speed would take all that its motor gives; inf where nothing is
        known of the motor."""
        friction, torque = holder("dry friction")
        slots = self._slots(knob)
        slots = tuple(s for s in slots if s in self.slots[friction])
        torques = (self.robot.bounds(friction, torque, s)[1] / self._speed(s) for s in slots)
        return min(torques, default=np.inf)

    def _speed(self, joint: str) -> float:
        """rad/s (m/s), root mean square over the runs."""
        return self.references.get(("torque", joint), 1.0) / self.references.get(("torque/speed", joint), 1.0)

    def _largest(self, kind: str, knob: Knob) -> float:
        if kind in ("1/run", "1/torque"):
            return self.reference(knob)
        slots = self._slots(knob)
        return max(self.references.get((kind, s), np.inf) for s in slots)
