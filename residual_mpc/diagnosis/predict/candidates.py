"""Which effects are candidates on these runs, and which are ruled out because no run can show them."""

import fnmatch
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.predict.references import longest_run, measure_references
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.predict.unshown import numbers_of_still, uncovered
from residual_mpc.effects.body import COULOMB
from residual_mpc.effects.command import BREAKAWAY_LOSS, COMMAND_DELAY
from residual_mpc.effects.drive import TURN_GAIN
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import BY_NAME, LIBRARY
from residual_mpc.effects.sensor import SENSOR_DELAY
from residual_mpc.effects.surroundings import TORQUE_OFFSET
from residual_mpc.models import optional
from residual_mpc.models.settings import TUNE, Knob, Term
from residual_mpc.models.targets import Targets

FITTED = tuple(e for e in LIBRARY if e.fitted)
NOTHING: Mapping[Term, str] = MappingProxyType({})
UNTOLD = "the angle of a wheel can be estimated only from pose.x, pose.y and pose.theta"
AS_TRACK = "without wheel encoders it cannot be told from another track"


def build_space(
    data: Dataset,
    tunable: Sequence[str],
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    because: Mapping[Term, str] = NOTHING,
    still: Collection[str] = (),
) -> Space:
    """Every effect-target pair that the robot of the first block can have, with references measured on the runs.

    because: terms that are ruled out beforehand, and why. still: channels in which the runs hardly move; what is
    tunable at such a joint, or at one that the model holds, keeps its nominal value, since nothing shows another.
    """
    robot = data.blocks[0].robot
    slots = Targets(robot)
    chosen = [e for e in FITTED if (not only or e.name in only) and e.name not in without]
    if COULOMB in chosen and slots[COULOMB.name]:  # dry friction of joints does the same as what a command loses
        chosen = [e for e in chosen if e is not BREAKAWAY_LOSS]
    candidates = tuple(t for e in chosen for t in _terms(e, slots[e.name], data))
    why = f"no run is longer than {(longest := longest_run(data)):.2g} s"
    ruled_out = {t: why for t in candidates if longest < BY_NAME[t.effect].seconds}
    if all(b.drive.angle is None for b in data.blocks):
        ruled_out |= {t: UNTOLD for t in candidates if BY_NAME[t.effect].place == "roundness"}
    if not any(f"velocity.{a}" in data.channels for a in robot.actuators):
        ruled_out |= {t: AS_TRACK for t in candidates if t.effect == TURN_GAIN.name}
    ruled_out |= {t: because[t] for t in candidates if t in because}
    arm = bool(slots[TORQUE_OFFSET.name])  # not reported for driving robots unless asked for
    absent = [e for e in chosen if not slots[e.name] and (e.name in only or arm and e.lacking)]
    ruled_out |= {Term(e.name, None): e.lacking or "this robot cannot have it" for e in absent}
    references = measure_references(data)
    ruled_out |= {t: why for t in candidates if (why := uncovered(t, slots[t.effect], robot, references))}
    candidates = tuple(t for t in candidates if t not in ruled_out)
    named = (name for name in robot.nominal() if any(fnmatch.fnmatchcase(name, p) for p in tunable))
    held = numbers_of_still(robot, {*still, *(f"position.{joint}" for joint in optional.held_joints(robot))})
    free = tuple(Knob(TUNE, None, name) for name in named if not name.startswith(held))
    return Space(robot, slots, candidates, free, references, ruled_out, twins=_twins(data))


def _twins(data: Dataset) -> tuple[frozenset[Term], ...]:
    """Commands that all take effect late and readings that all arrive late are the same shift of time, unless a motor
    is switched off in between: it stops at once."""
    switched = any(b.drive.enabled is not None and not (b.drive.enabled == 1.0).all() for b in data.blocks)
    return () if switched else (frozenset({Term(COMMAND_DELAY.name, None), Term(SENSOR_DELAY.name, None)}),)


def _terms(effect: Effect, slots: tuple[str, ...], data: Dataset) -> list[Term]:
    """All targets alike, and each target alone. A robot's only target is named by no target."""
    if not slots:
        return []
    if effect.target == "channel" and slots == ("pose",):
        encoders = any(c.startswith("velocity.") for c in data.channels)
        return [Term(effect.name, "pose" if encoders else None)]
    if effect.target == "channel" and not effect.null_target:
        return [Term(effect.name, s) for s in slots if s in data.channels]
    if len(slots) == 1:
        return [Term(effect.name, None)]
    return ([Term(effect.name, None)] if effect.null_target else []) + [Term(effect.name, s) for s in slots]
