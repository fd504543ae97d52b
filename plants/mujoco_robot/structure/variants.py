"""Several settings of one robot in one batch: models that differ only in numbers become per-simulation values."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from plants.mujoco_robot.structure.base import Base
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

R = TypeVar("R", bound=CompiledRobot)


def merge(robots: Sequence[R]) -> R | None:
    """One robot whose i-th setting is robots[i]; None where they differ in more than numbers that a batch can
    expand.
    """
    first = robots[0]
    for other in robots[1:]:
        same = (
            other.actuators == first.actuators
            and other.joints == first.joints
            and other.links == first.links
            and other.command_kinds == first.command_kinds
            and other.actuator_joints == first.actuator_joints
            and other.servo_feedback == first.servo_feedback
            and other.position_sensor == first.position_sensor
            and _same_base(other.base, first.base)
            and other.passive == first.passive
            and other.payload[0] == first.payload[0]
            and np.array_equal(other.payload[1], first.payload[1])
            and np.array_equal(other.payload_axes, first.payload_axes)
            and other.step == first.step
        )
        if not same:
            return None
    fields = _differing(robots)
    return None if fields is None else replace(first, settings=tuple(robots), differing=fields)


def _same_base(one: Base | None, other: Base | None) -> bool:
    """Whether both are fixed, or stand and roll alike."""
    if one is None or other is None:
        return one is other
    same = (one.body, one.q, one.v) == (other.body, other.q, other.v)
    alike = np.allclose(one.upright, other.upright) and np.allclose(one.rolling, other.rolling)
    return same and alike and bool(np.isclose(one.height, other.height))


def _differing(robots: Sequence[CompiledRobot]) -> tuple[str, ...] | None:
    """Names of the model fields that differ; None where one of them has another shape or cannot be expanded."""
    from mujoco.batch import MODEL_FIELDS

    first = robots[0].model
    found = []
    for name in dir(first):
        if name.startswith("_") or name in ("names", "opt", "stat", "vis", "signature"):
            continue
        values = [getattr(r.model, name) for r in robots]
        if callable(values[0]) or all(np.array_equal(v, values[0]) for v in values[1:]):
            continue
        if name not in MODEL_FIELDS or any(np.shape(v) != np.shape(values[0]) for v in values):
            return None
        found.append(name)
    options = [_options(r) for r in robots]
    return None if any(o != options[0] for o in options[1:]) else tuple(found)


def _options(robot: CompiledRobot) -> dict[str, object]:
    opt = robot.model.opt
    names = [n for n in dir(opt) if not n.startswith("_") and not callable(getattr(opt, n))]
    return {n: np.asarray(getattr(opt, n)).tolist() for n in names}
