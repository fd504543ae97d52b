"""A robot with other ranges of its joints and of its commands."""

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot

if TYPE_CHECKING:
    import mujoco

DEGREE = 180.0 / np.pi  # of a specification whose compiler takes angles in degrees
Range = tuple[float, float]
AnyRobot = TypeVar("AnyRobot", bound=CompiledRobot)


def with_ranges(robot: AnyRobot, joints: Mapping[str, Range], commands: Mapping[str, Range]) -> AnyRobot:
    """The robot with these ranges in its compiled model and in the specification that others are compiled from."""
    model = copy(robot.model)
    spec = None if robot.spec is None else robot.spec.copy()
    for joint, ends in joints.items():
        model.jnt_range[robot.numbers[robot.joints.index(joint)]] = ends
    for actuator, ends in commands.items():
        model.actuator_ctrlrange[robot.actuators.index(actuator)] = ends
    if spec is not None:
        _write(spec, robot, joints, commands)
    return replace(robot, model=model, spec=spec)


def _write(
    spec: "mujoco.MjSpec", robot: CompiledRobot, joints: Mapping[str, Range], commands: Mapping[str, Range]
) -> None:
    for joint, ends in joints.items():
        unit = DEGREE if spec.compiler.degree and joint not in robot.sliding else 1.0
        spec.joint(joint).range = unit * np.array(ends)
    for actuator, ends in commands.items():
        at = spec.actuator(actuator)
        at.ctrllimited, at.ctrlrange, at.inheritrange = True, np.array(ends), 0.0
