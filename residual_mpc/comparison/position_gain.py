"""Whether the position gain of a servo alone may have changed where the gain of its whole force is named.

The force of a position servo is kp (u - q) - kd v. If kp alone became g times as large, and not kd with it, the gain g
of both misses the force (1 - g) kd v at the joint: a viscous friction (1 - g) kd, positive where the gain fell. A new
P gain and another supply voltage change kp alone, since the damping of a servo is mostly its motor's back-EMF. The
library has no effect for that.
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

LARGEST = 50.0  # logarithm of a likelihood ratio beyond which no doubt is left
WORTH_A_NOTE = 0.95  # share of the likelihood below which the position gain alone is not ruled out


class Estimate(NamedTuple):
    """A change of a joint's viscous friction that the named changes leave, N m s/rad: value, standard error."""

    value: float
    error: float


@dataclass(frozen=True)
class ServoDoubt:
    """gain: a named gain of a servo; share: of the likelihood that it keeps beside a change of the position gain alone;
    friction: the named viscous friction that makes the two a change of the position gain alone, None without."""

    gain: Term
    share: float
    friction: Term | None = None

    @property
    def better(self) -> bool:
        """Whether the position gain alone explains more."""
        return self.share < 0.5


def servo_doubts(
    changes: Sequence[Change], robots: Sequence[Robot], told: Sequence[Contrast]
) -> tuple[ServoDoubt, ...]:
    """One for each named gain of a position servo that has a damping of its own. told: the contrasts of what the named
    changes leave."""
    out = []
    for change in changes:
        if change.term.effect != ACTUATOR_GAIN.name:
            continue
        number = change.parameters[0]
        scale = 1.0 if number.before is None else number.before  # the gain of both sets scales the damping too
        dampings = {j: scale * d for j, d in servo_dampings(robots, change.term.target).items()}
        frictions = [c for c in changes if c.term.effect == VISCOUS.name]
        fitting = [c.term for c in frictions if completes(number, c, dampings)]
        share = share_of_whole_gain(number.change, dampings, told)
        if fitting:
            out.append(ServoDoubt(change.term, 0.0, fitting[0]))
        elif share is not None:
            out.append(ServoDoubt(change.term, share))
    return tuple(out)


def completes(gain: ChangedNumber, friction: Change, dampings: dict[str, float]) -> bool:
    """Whether a named change of the viscous friction is, within both intervals and beyond its own, what the position
    gain alone would leave of the gain; or as much of it as a bound lets it be. dampings: of the servos, N m s/rad by
    joint."""
    acted = [d for joint, d in dampings.items() if friction.term.target in (joint, None)]
    if not acted:
        return False
    found, damping = friction.parameters[0], float(np.mean(acted))
    missed = (1.0 - gain.change) * damping
    off = float(np.hypot(_half(found), damping * _half(gain)))
    if abs(missed) <= off:
        return False
    short = bool(found.note) and 0.0 < found.change / missed < 1.0  # no less friction than none
    return short or abs(found.change - missed) <= off


def _half(number: ChangedNumber) -> float:
    return 0.5 * (number.ci95[1] - number.ci95[0])


def doubted(changes: Sequence[Change], doubts: Sequence[ServoDoubt], doubtful: float) -> tuple[Change, ...]:
    """The changes with lower probabilities where the position gain alone explains as much, doubtful at most where the
    two of them are such a change."""
    out = []
    for change in changes:
        for doubt in doubts:
            if doubt.friction is not None and change.term in (doubt.gain, doubt.friction):
                change = replace(change, probability=min(change.probability, doubtful))
            elif change.term == doubt.gain:
                change = replace(change, probability=change.probability * doubt.share)
        out.append(change)
    return tuple(out)


def notes_on(doubts: Sequence[ServoDoubt]) -> tuple[str, ...]:
    """What a reader has to know of the gains of servos."""
    out = []
    for doubt in doubts:
        if doubt.friction is not None:
            out.append(
                f"{doubt.gain} and {doubt.friction} together are what a change of the position gain alone does, with "
                "the servo's damping as it was (a new P gain or supply voltage): that is more probable than both, but "
                "the library has no such effect"
            )
        elif doubt.share < WORTH_A_NOTE:
            how = "explains the runs better" if doubt.better else "is not ruled out"
            out.append(
                f"{doubt.gain}: a change of the position gain alone, with the servo's damping as it was (a new P gain "
                f"or supply voltage), {how}: its share of the likelihood is {1.0 - doubt.share:.2f}, but the library "
                "has no such effect"
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
