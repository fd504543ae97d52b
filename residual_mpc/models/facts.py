"""What the audit has to know of a robot, and whether a run's columns fit it."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.audit import ActuatorFacts, RobotFacts
from residual_mpc.logs.audit.facts import CommandKind
from residual_mpc.logs.columns import did_you_mean
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.parameter_units import command_units
from residual_mpc.models.protocol import Robot
from residual_mpc.models.robot_file import WHEELS

SLOW = 1e-3  # rad/s or m/s: so slow that nothing but damping depends on the speed
PLACE, HEADING = ("pose.x", "pose.y"), "pose.theta"


def facts_of(robot: Robot) -> RobotFacts:
    """Names and kinds, for the audit."""
    joints = optional.actuator_joints(robot)
    kinds: dict[str, CommandKind] = {
        "position": "position",
        "torque": "torque",
        "speed": "velocity",
        "velocity": "velocity",
    }
    gears = [g if g else 1.0 for g in optional.gear_ratios(robot)]
    lags = _servo_lags(robot, gears)
    driven = zip(robot.actuators, joints, robot.command_kinds, gears, command_units(robot), lags, strict=True)
    return RobotFacts(
        tuple(
            ActuatorFacts(a, j, kinds[k], 1.0 if k == "torque" else g, unit == "1", lag)
            for a, j, k, g, unit, lag in driven
        ),
        robot.channels,
        optional.sliding(robot),
        optional.limits(robot),
        optional.clamps(robot),
        robot.nominal().get(WHEELS[0]) if set(robot.command_kinds) == {"speed"} else None,
    )


def _servo_lags(robot: Robot, gears: Sequence[float]) -> list[float | None]:
    """s: how far each position servo of the model is behind its command in a steady motion, over its speed. Opposite
    speeds at one place leave out what carries the load."""
    if not robot.states:
        return [None] * len(robot.actuators)
    motion = {s.position: np.zeros(2) for s in robot.states}
    motion |= {s.velocity: np.array([SLOW, -SLOW]) for s in robot.states if s.velocity is not None}
    ahead, back = optional.steady_setpoints(robot, motion)
    lags = (ahead - back) / (2.0 * SLOW * np.array(gears))
    return [float(lag) if np.isfinite(lag) else None for lag in lags]


def check_columns(runs: Sequence[Run], robots: Sequence[Robot]) -> None:
    """Every actuator needs a command, something has to be measured that the robot can predict, and a position on the
    plane needs a heading.

    Raises BadInput with the run, the column that is missing and the nearest that is there.
    """
    for run, robot in zip(runs, robots, strict=True):
        for actuator in optional.held(robot):
            if f"command.{actuator}" in run.columns:
                raise BadInput(
                    f"column command.{actuator} is for an actuator that is held still",
                    f"{run.source}, run {run.name}",
                    "to keep it held, delete its line under [log] in the robot file, or the column; to drive it, "
                    "remove it from `held` in the robot file, or give the actuator joint=... in the model",
                )
        for actuator in robot.actuators:
            if f"command.{actuator}" not in run.columns:
                taken = {*robot.channels, *(f"command.{a}" for a in robot.actuators)}
                there = [c for c in (*run.columns, *run.extra) if c not in taken]
                if {"command.linear", "command.angular"} <= set(run.columns):
                    raise BadInput(
                        f"column command.{actuator} is missing, and a body velocity needs the geometry of the wheels",
                        f"{run.source}, run {run.name}",
                        "state wheel_radius and track_width under [parameters] in the robot file",
                    )
                raise BadInput(
                    f"column command.{actuator} is missing",
                    f"{run.source}, run {run.name}",
                    f"{did_you_mean('command.' + actuator, there)}; map it under [log] in the robot file, or "
                    f'set held = ["{actuator}"] there if nobody commands it',
                )
        if not any(c in robot.channels for c in run.measured):
            raise BadInput(
                "the robot's model predicts none of the measured columns",
                f"{run.source}, run {run.name}",
                f"it predicts {', '.join(robot.channels[:8])}; map your columns under [log] in the robot file",
            )
        _check_heading(run, robot)


def _check_heading(run: Run, robot: Robot) -> None:
    """A position on the plane can only be predicted from the heading at the start of a window."""
    place = " and ".join(c for c in PLACE if c in run.measured)
    if HEADING not in robot.channels or HEADING in run.measured or not place:
        return
    raise BadInput(
        f"{place} cannot be predicted without the heading {HEADING}, which this run lacks",
        f"{run.source}, run {run.name}",
        f"log the heading as {HEADING} (rad), or map its column under [log] in the robot file; without one, remove "
        f"{place} and log the wheel speeds (velocity.<wheel>) or the yaw rate (twist.theta)",
    )
