"""Checks whether a named actuator gain of a servo may be a change of its position gain alone.

The force of a position servo is kp (u - q) - kd v. `actuator_gain` multiplies both terms by g. If only kp is multiplied
by g, a model with that gain lacks a force of -(1 - g) kd v at the joint: a viscous friction of (1 - g) kd, positive if
g < 1. A new P gain or another supply voltage changes kp alone, since the damping of a servo is mostly the back-EMF of
its motor. The library has no effect for this.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from residual_mpc.comparison.contrast import Contrast
from residual_mpc.comparison.records import Change, ChangedNumber
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.body import VISCOUS
from residual_mpc.models.actuator_values import ListsActuators
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Term

LARGEST = 50.0  # log likelihood ratios are clipped here, to avoid overflow
WORTH_A_NOTE = 0.95  # a note is written if the gain's share of the likelihood is below this


class Estimate(NamedTuple):
    """Change of a joint's viscous friction, estimated with the named changes in the model, N m s/rad: value, standard
    error."""

    value: float
    error: float


@dataclass(frozen=True)
class ServoDoubt:
    """gain: a named gain of a servo; share: its share of the likelihood, against a change of the position gain alone;
    frictions: named viscous frictions that together with the gain are such a change, else none."""

    gain: Term
    share: float
    frictions: tuple[Term, ...] = ()

    @property
    def better(self) -> bool:
        """Whether the position gain alone explains more."""
        return self.share < 0.5


def servo_doubts(
    changes: Sequence[Change], robots: Sequence[Robot], told: Sequence[Contrast]
) -> tuple[ServoDoubt, ...]:
    """One entry per named gain of a position servo with damping whose friction could be checked. told: the contrasts
    with the named changes in the model."""
    out = []
    frictions = [c for c in changes if c.term.effect == VISCOUS.name]
    for change in changes:
        if change.term.effect != ACTUATOR_GAIN.name:
            continue
        number = change.parameters[0]
        scale = 1.0 if number.before is None else number.before  # the gain of both sets scales the damping too
        dampings = {j: scale * d for j, d in servo_dampings(robots, change.term.target).items()}
        fitting = [c.term for c in frictions if completes(number, c, dampings)]
        covered = all(any(t.target in (joint, None) for t in fitting) for joint in dampings)
        share = share_of_whole_gain(number.change, dampings, told)
        if fitting and covered:
            out.append(ServoDoubt(change.term, 1.0, tuple(fitting)))
        elif share is not None:
            out.append(ServoDoubt(change.term, share))
    return tuple(out)


def completes(gain: ChangedNumber, friction: Change, dampings: dict[str, float]) -> bool:
    """Whether a named change of the viscous friction equals (1 - gain) times the damping within the combined intervals,
    which must be narrower than that value. dampings: of the servos, N m s/rad by joint."""
    acted = [d for joint, d in dampings.items() if friction.term.target in (joint, None)]
    if not acted:
        return False
    found, damping = friction.parameters[0], float(np.mean(acted))
    missed = (1.0 - gain.change) * damping
    off = float(np.hypot(_half(found), damping * _half(gain)))
    return abs(missed) > off >= abs(found.change - missed)


def _half(number: ChangedNumber) -> float:
    return 0.5 * (number.ci95[1] - number.ci95[0])


def judged(changes: Sequence[Change], doubts: Sequence[ServoDoubt]) -> tuple[Change, ...]:
    """The changes, with lower probabilities for gains that may be a change of the position gain alone. A gain and the
    friction that completes it are equally probable: together they are a single number."""
    shares = {doubt.gain: doubt.share for doubt in doubts}
    sure = {c.term: c.probability * shares.get(c.term, 1.0) for c in changes}
    for doubt in doubts:
        if doubt.frictions:
            together = (doubt.gain, *doubt.frictions)
            sure |= dict.fromkeys(together, max(sure[term] for term in together))
    return tuple(replace(c, probability=sure[c.term]) for c in changes)


def notes_on(doubts: Sequence[ServoDoubt]) -> tuple[str, ...]:
    """Notes on named gains that may be a change of the position gain alone."""
    out = []
    for doubt in doubts:
        if doubt.frictions:
            names = " and ".join(str(t) for t in (doubt.gain, *doubt.frictions))
            out.append(
                f"{names} together are a change of the position gain alone, with the servo's damping unchanged (a new "
                "P gain or supply voltage)"
            )
        elif doubt.share < WORTH_A_NOTE:
            how = "explains the runs better" if doubt.better else "is not ruled out"
            out.append(
                f"{doubt.gain}: a change of the position gain alone, with the servo's damping unchanged (a new P gain "
                f"or supply voltage), {how}: its share of the likelihood is {1.0 - doubt.share:.2f}. It would be a "
                "gain and a viscous friction together"
            )
    return tuple(out)


def share_of_whole_gain(gain: float, dampings: dict[str, float], told: Sequence[Contrast]) -> float | None:
    """The share of the likelihood that a changed gain of a servo's whole force keeps beside a change of its position
    gain alone. None where no servo has a damping of its own, or where the viscous friction was not tested.

    told: the contrasts of what the named changes leave; gain: the factor that was found; dampings: N m s/rad by joint.
    """
    ratio, tested = 0.0, False
    for joint, damping in dampings.items():
        found = estimate_of(told, joint)
        if found is None:
            continue
        missed = (1.0 - gain) * damping
        ratio += (found.value**2 - (found.value - missed) ** 2) / found.error**2
        tested = True
    return 1.0 / (1.0 + float(np.exp(np.clip(0.5 * ratio, -LARGEST, LARGEST)))) if tested else None


def servo_dampings(robots: Sequence[Robot], actuator: str | None) -> dict[str, float]:
    """N m s/rad by joint, the mean over the robots' settings: of the position servos that an actuator names, or of all
    where it is None."""
    found: dict[str, list[float]] = {}
    for robot in {id(r): r for r in robots}.values():
        for v in robot.actuator_values(Settings(1)) if isinstance(robot, ListsActuators) else ():
            if v.kind == "position" and v.damping > 0.0 and actuator in (None, v.actuator):
                found.setdefault(v.joint, []).append(v.damping)
    return {joint: float(np.mean(values)) for joint, values in found.items()}


def estimate_of(told: Sequence[Contrast], joint: str) -> Estimate | None:
    """The change of a joint's viscous friction; of one that is the same at all joints where this joint has none of its
    own. None where it was not tested."""
    mine = [c for c in told if c.term.effect == VISCOUS.name and c.term.target in (joint, None) and c.z != 0.0]
    if not mine:
        return None
    best = max(mine, key=lambda c: (c.term.target == joint, abs(c.z)))
    (size,) = best.probe.values()
    value = best.dose * size
    return Estimate(value, abs(value / best.z))
