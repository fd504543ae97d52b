"""What a robot may say of itself beside `residual_mpc.models.protocol.Robot`, and what holds where it does not.

Each optional member is declared by a protocol of its own and read by the function of its name, which gives the default:

    optional.limits(robot)    # robot.limits, or {} of a robot that does not state them

`residual_mpc.models.contract` checks the members that a robot has. Larger abilities are protocols elsewhere:
`Merging` and `Inverting` in `protocol`, `Stepping` in `stepping`, `Simulating` and `WritesMjcf` in `simulating`, those
of pictures in `drawing`.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from residual_mpc.models.protocol import Robot
from residual_mpc.models.stepping import BODY
from residual_mpc.models.wrapped import innermost

USUAL_PERIOD = 0.05  # s, of a controller

Range = tuple[float, float]


@runtime_checkable
class ActuatorJoints(Protocol):
    @property
    def actuator_joints(self) -> tuple[str, ...]:
        """The joint that each actuator drives, in the order of `actuators`."""
        ...


@runtime_checkable
class GearRatios(Protocol):
    @property
    def gear_ratios(self) -> tuple[float, ...]:
        """The torque (force) at the joint per unit of each actuator's output, in the order of `actuators`."""
        ...


@runtime_checkable
class SteadySetpoints(Protocol):
    def steady_setpoints(self, motion: Mapping[str, np.ndarray]) -> np.ndarray:
        """(W, actuators) the setpoint of each position servo, in units of its command, that sustains the given motion:
        W positions (and velocities) by channel; what is missing or NaN is taken to be at rest. NaN where that says
        nothing: of other actuators, and where a servo's law is another."""
        ...


@runtime_checkable
class Joints(Protocol):
    @property
    def joints(self) -> tuple[str, ...]:
        """All joints, those without an actuator among them."""
        ...


@runtime_checkable
class Sliding(Protocol):
    @property
    def sliding(self) -> frozenset[str]:
        """Joints that slide (m); the others turn (rad)."""
        ...


@runtime_checkable
class Limits(Protocol):
    @property
    def limits(self) -> Mapping[str, Range]:
        """Joint -> its range, rad or m, for joints that have one."""
        ...


@runtime_checkable
class SpeedLimits(Protocol):
    @property
    def speed_limits(self) -> Mapping[str, float]:
        """Joint -> its largest speed, rad/s or m/s, for joints that have one."""
        ...


@runtime_checkable
class CommandLimits(Protocol):
    @property
    def command_limits(self) -> Mapping[str, Range]:
        """Actuator -> lowest and highest command, actuator units, for actuators that have them."""
        ...


@runtime_checkable
class ClampsCommands(Protocol):
    @property
    def clamps(self) -> Mapping[str, Range]:
        """Actuator -> range of its command, actuator units, for actuators whose command the model clips."""
        ...


@runtime_checkable
class LimitsForces(Protocol):
    @property
    def force_limits(self) -> Mapping[str, float]:
        """Actuator -> largest force that the model lets it give, N m or N, for actuators whose force it limits."""
        ...


@runtime_checkable
class Widening(Protocol):
    def with_ranges(self, joints: Mapping[str, Range], commands: Mapping[str, Range]) -> Robot:
        """This robot with other ranges of joints (rad, m) and of commands that it clips (actuator units)."""
        ...


@runtime_checkable
class Touching(Protocol):
    def overlaps(self, positions: Mapping[str, np.ndarray]) -> Mapping[tuple[str, str], np.ndarray]:
        """(rows,) m by which the shapes of two bodies that may touch overlap at positions (rows,) of joints, rad or m;
        what does not move is the empty name."""
        ...

    def without_contacts(self, pairs: Sequence[tuple[str, str]]) -> Robot:
        """This robot without contact between these bodies."""
        ...


@runtime_checkable
class Rest(Protocol):
    @property
    def rest(self) -> Mapping[str, float]:
        """Position channel -> where it is at the start if nobody measures it, channel unit."""
        ...


@runtime_checkable
class Held(Protocol):
    @property
    def held(self) -> tuple[str, ...]:
        """Actuators of the model file that the model holds still: a run may not hold commands for them."""
        ...


@runtime_checkable
class HeldJoints(Protocol):
    @property
    def held_joints(self) -> tuple[str, ...]:
        """Joints that the model holds where they start: their positions belong to the start, and are not compared."""
        ...


@runtime_checkable
class PayloadPlace(Protocol):
    @property
    def payload_place(self) -> tuple[float, float, float, float]:
        """The number of the body that holds the payload, and where, m in its frame."""
        ...


@runtime_checkable
class Period(Protocol):
    @property
    def period(self) -> float:
        """s between commands, which becomes the usual step of the robot's exported model."""
        ...


@runtime_checkable
class Disturbed(Protocol):
    @property
    def disturbed(self) -> tuple[str, ...]:
        """Signals of the step to which offset-free tracking adds an unknown constant."""
        ...


@runtime_checkable
class HalvingStep(Protocol):
    def with_half_step(self) -> Robot | None:
        """The same robot simulated at half the time step, for the same drives and nodes; None where that cannot be."""
        ...


@runtime_checkable
class LengtheningStep(Protocol):
    def with_longer_step(self, times: int) -> Robot | None:
        """The same robot with a `step` that is `times` as long, which simulates faster and less exactly; None where
        that cannot be."""
        ...


@runtime_checkable
class Rough(Protocol):
    @property
    def rough(self) -> bool:
        """Whether predictions jump as a number changes, as they do where wheels or feet slip and stick."""
        ...


def actuator_joints(robot: Robot) -> tuple[str, ...]:
    """The joint that each actuator drives; by default they share their names."""
    robot = innermost(robot)
    return robot.actuator_joints if isinstance(robot, ActuatorJoints) else robot.actuators


def gear_ratios(robot: Robot) -> tuple[float, ...]:
    """The torque (force) at the joint per unit of each actuator's output; 1 by default."""
    robot = innermost(robot)
    return robot.gear_ratios if isinstance(robot, GearRatios) else (1.0,) * len(robot.actuators)


def steady_setpoints(robot: Robot, motion: Mapping[str, np.ndarray]) -> np.ndarray:
    """(W, actuators) the setpoints that keep W motions going; NaN, not known, by default."""
    robot = innermost(robot)
    if isinstance(robot, SteadySetpoints):
        return robot.steady_setpoints(motion)
    return np.full((max(map(len, motion.values()), default=0), len(robot.actuators)), np.nan)


def joints(robot: Robot) -> tuple[str, ...]:
    """All joints; by default those that the actuators drive."""
    robot = innermost(robot)
    return robot.joints if isinstance(robot, Joints) else tuple(dict.fromkeys(actuator_joints(robot)))


def sliding(robot: Robot) -> frozenset[str]:
    """Joints that slide; by default none."""
    robot = innermost(robot)
    return robot.sliding if isinstance(robot, Sliding) else frozenset()


def limits(robot: Robot) -> Mapping[str, Range]:
    """Ranges of joints, rad or m; by default none is known."""
    robot = innermost(robot)
    return robot.limits if isinstance(robot, Limits) else {}


def speed_limits(robot: Robot) -> Mapping[str, float]:
    """Joint -> its largest speed, rad/s or m/s; by default none."""
    robot = innermost(robot)
    return robot.speed_limits if isinstance(robot, SpeedLimits) else {}


def command_limits(robot: Robot) -> Mapping[str, Range]:
    """Ranges of commands, actuator units; by default none is known."""
    robot = innermost(robot)
    return robot.command_limits if isinstance(robot, CommandLimits) else {}


def clamps(robot: Robot) -> Mapping[str, Range]:
    """Ranges of the commands that the model clips, actuator units; by default it clips none."""
    robot = innermost(robot)
    return robot.clamps if isinstance(robot, ClampsCommands) else {}


def force_limits(robot: Robot) -> Mapping[str, float]:
    """Largest forces of the actuators, N m or N, where the model limits them; by default it limits none."""
    robot = innermost(robot)
    return robot.force_limits if isinstance(robot, LimitsForces) else {}


def with_ranges(robot: Robot, joints: Mapping[str, Range], commands: Mapping[str, Range]) -> Robot:
    """The robot with other ranges of joints and clipped commands; by default the robot itself."""
    return robot.with_ranges(joints, commands) if isinstance(robot, Widening) else robot


def overlaps(robot: Robot, positions: Mapping[str, np.ndarray]) -> Mapping[tuple[str, str], np.ndarray]:
    """Depths (rows,) m to which shapes of the robot overlap at positions (rows,) of joints; by default it has none."""
    return robot.overlaps(positions) if isinstance(robot, Touching) else {}


def without_contacts(robot: Robot, pairs: Sequence[tuple[str, str]]) -> Robot:
    """The robot without contact between these bodies; by default the robot itself."""
    return robot.without_contacts(pairs) if isinstance(robot, Touching) else robot


def rest(robot: Robot) -> Mapping[str, float]:
    """Starts of position channels that nobody measures; by default 0, by no entry."""
    robot = innermost(robot)
    return robot.rest if isinstance(robot, Rest) else {}


def held(robot: Robot) -> tuple[str, ...]:
    """Actuators that the model holds still; by default none."""
    robot = innermost(robot)
    return robot.held if isinstance(robot, Held) else ()


def held_joints(robot: Robot) -> tuple[str, ...]:
    """Joints that the model holds where they start; by default none."""
    robot = innermost(robot)
    return robot.held_joints if isinstance(robot, HeldJoints) else ()


def payload_place(robot: Robot) -> tuple[float, float, float, float] | None:
    """The number of the body that holds the payload, and where, m in its frame; by default None."""
    robot = innermost(robot)
    return robot.payload_place if isinstance(robot, PayloadPlace) else None


def period(robot: Robot) -> float:
    """s between commands; by default USUAL_PERIOD."""
    robot = innermost(robot)
    return robot.period if isinstance(robot, Period) else USUAL_PERIOD


def disturbed(robot: Robot) -> tuple[str, ...]:
    """Signals that offset-free tracking disturbs; by default the velocities of a robot that drives."""
    robot = innermost(robot)
    return robot.disturbed if isinstance(robot, Disturbed) else BODY


def rough(robot: Robot) -> bool:
    """Whether predictions jump as a number changes; by default not."""
    robot = innermost(robot)
    return robot.rough if isinstance(robot, Rough) else False


def with_half_step(robot: Robot) -> Robot | None:
    """The robot simulated at half its time step; by default None, as of one that integrates exactly."""
    return robot.with_half_step() if isinstance(robot, HalvingStep) else None


def with_longer_step(robot: Robot, times: int) -> Robot | None:
    """The robot with a step that is `times` as long; by default None."""
    return robot.with_longer_step(times) if isinstance(robot, LengtheningStep) else None
