"""The contract of a robot's optional members: `residual_mpc.models.optional`, and `Stepping`."""

from collections.abc import Mapping
from numbers import Real

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.models import optional
from residual_mpc.models.contract.demand import demand
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings
from residual_mpc.models.stepping import StepOptions, Stepping


def check_optional(robot: Robot) -> None:
    """Check the optional members that a robot has. Raises ContractBroken at the first law that is broken."""
    _check_joints(robot)
    _check_ranges("limits", optional.limits(robot), optional.joints(robot))
    _check_ranges("command_limits", optional.command_limits(robot), robot.actuators)
    _check_ranges("clamps", optional.clamps(robot), robot.actuators)
    _check_forces(optional.force_limits(robot), robot.actuators)
    _check_rest(robot)
    _check_names("held", optional.held(robot))
    for actuator in optional.held(robot):
        law = "an actuator that is held is not commanded"
        demand(actuator not in robot.actuators, law, repr(actuator), "a name that is not in actuators")
    period = optional.period(robot)
    demand(_is_number(period) and period > 0, "period is a time", repr(period), "a positive number of seconds")
    halved = optional.with_half_step(robot)
    same = halved is None or (halved.channels == robot.channels and halved.step == robot.step)
    demand(same, "with half the step a robot takes the same drives", "another robot", "equal channels and step")
    longer = optional.with_longer_step(robot, 2)
    if longer is not None:
        twice = longer.channels == robot.channels and robot.step is not None and longer.step == 2 * robot.step
        demand(twice, "a longer step is a multiple of the step", f"{longer.step} s", "equal channels, twice the step")
    if isinstance(robot, optional.Widening):
        wide = {j: (low - 1.0, high + 1.0) for j, (low, high) in optional.limits(robot).items()}
        found = dict(optional.limits(robot.with_ranges(wide, {})))
        demand(found == wide, "with_ranges gives the joints their ranges", repr(found), repr(wide))
    if isinstance(robot, Stepping):
        _check_step(robot, robot, period)


def _check_joints(robot: Robot) -> None:
    driven, joints, sliding = optional.actuator_joints(robot), optional.joints(robot), optional.sliding(robot)
    _check_names("actuator_joints", driven)
    count = len(robot.actuators)
    demand(len(driven) == count, "actuator_joints has one joint an actuator", repr(driven), f"{count} names")
    _check_names("joints", joints)
    demand(len(set(joints)) == len(joints), "joints are distinct", repr(joints), "each name once")
    for joint in driven:
        demand(joint in joints, "an actuator drives one of the joints", repr(joint), f"one of {joints}")
    demand(isinstance(sliding, frozenset), "sliding is a frozenset", repr(sliding), "a frozenset of joints")
    for joint in sliding:
        demand(joint in joints, "sliding names joints", repr(joint), f"one of {joints}")


def _check_names(member: str, names: object) -> None:
    texts = isinstance(names, tuple) and all(isinstance(n, str) and n for n in names)
    demand(texts, f"{member} is a tuple of names", repr(names), "a tuple of strings")


def _check_ranges(member: str, ranges: object, known: tuple[str, ...]) -> None:
    mapping = isinstance(ranges, Mapping)
    demand(mapping, f"{member} is a mapping", repr(ranges), "name -> (lower, upper)")
    assert isinstance(ranges, Mapping)
    for name, pair in ranges.items():
        demand(name in known, f"{member} is by name", repr(name), f"one of {known}")
        two = isinstance(pair, tuple | list) and len(pair) == 2 and all(isinstance(x, Real) for x in pair)
        ordered = two and bool(float(pair[0]) < float(pair[1]))
        demand(ordered, f"{member} of {name} is a range", repr(pair), "two numbers, lower < upper")


def _check_forces(limits: object, known: tuple[str, ...]) -> None:
    demand(isinstance(limits, Mapping), "force_limits is a mapping", repr(limits), "actuator -> largest force")
    assert isinstance(limits, Mapping)
    for name, force in limits.items():
        demand(name in known, "force_limits is by actuator", repr(name), f"one of {known}")
        positive = _is_number(force) and float(force) >= 0.0
        demand(positive, f"force_limits of {name} is a force", repr(force), "a finite number, 0 or more")


def _check_rest(robot: Robot) -> None:
    rest, positions = optional.rest(robot), tuple(s.position for s in robot.states)
    demand(isinstance(rest, Mapping), "rest is a mapping", repr(rest), "position channel -> number")
    for channel, value in rest.items():
        demand(channel in positions, "rest is by position channel", repr(channel), f"one of {positions}")
        demand(_is_number(value), f"rest of {channel} is a number", repr(value), "a finite number")


def _check_step(robot: Robot, stepping: Stepping, dt: float) -> None:
    """The symbolic step takes the robot's commands, and has the signals that `disturbed` names."""
    try:
        stepped = stepping.one_step(Settings(1), StepOptions(dt))
    except BadInput:  # a robot may say its step in general, and refuse it for this model with the reason
        return
    law = "the step takes the robot's commands"
    demand(stepped.commands == robot.actuators, law, repr(stepped.commands), f"{robot.actuators}")
    if isinstance(robot, optional.Disturbed):
        _check_names("disturbed", robot.disturbed)
        for signal in robot.disturbed:
            law = "disturbed names signals of the step"
            demand(signal in stepped.signals, law, repr(signal), f"one of {stepped.signals}")


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and bool(np.isfinite(float(value)))
