"""The little that the audit has to know about a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from residual_mpc.logs.run import FloatArray, Run, held

CommandKind = Literal["position", "velocity", "torque"]


@dataclass(frozen=True)
class ActuatorFacts:
    """One actuator: its name as in `command.<name>`, the joint it drives, and what its command asks for.

    Attributes:
        name: as in `command.<name>`.
        joint: as in `position.<joint>`, None where it drives no single joint.
        kind: what the command asks of the joint.
        gear: of a servo, its command over the joint's position or velocity; negative where they go opposite ways.
        share: whether the command is a share of the motor's torque, without a unit.
        lag: s by which the model's own servo is behind its command in a steady motion, None where that is not known.
    """

    name: str
    joint: str | None
    kind: CommandKind
    gear: float = 1.0
    share: bool = False
    lag: float | None = None


@dataclass(frozen=True)
class RobotFacts:
    """A robot as the audit sees it.

    Attributes:
        actuators: in the robot's order.
        channels: measured columns that the robot's model predicts, such as `position.j1` and `pose.x`.
        sliding: joints that slide (m) and do not turn (rad).
        limits: range of each joint that has one, rad or m.
        clamps: range of each command that the model clips, its unit.
        wheel_radius: m, of a robot whose commands are wheel speeds.
    """

    actuators: tuple[ActuatorFacts, ...]
    channels: tuple[str, ...]
    sliding: frozenset[str] = frozenset()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    clamps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    wheel_radius: float | None = None


def wheel_commands(run: Run, robot: RobotFacts) -> list[FloatArray]:
    """The commands (n,) of a robot's wheels, as they are held; none of any other robot, or where one is missing."""
    names = [f"command.{a.name}" for a in robot.actuators if a.kind == "velocity"]
    there = len(names) == len(robot.actuators) and set(names) <= set(run.columns)
    return [held(run, name) for name in names] if there else []
