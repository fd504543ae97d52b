"""The units of an effect's parameter and of a command on a robot."""

from residual_mpc.effects.library import BY_NAME
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Knob, Term
from residual_mpc.models.sliding_units import sliding_unit

_COMMAND = {"speed": "rad/s", "velocity": "rad/s", "position": "rad", "torque": "N m"}


def command_units(robot: Robot) -> tuple[str, ...]:
    """The unit of each actuator's command."""
    slides, clamps = optional.sliding(robot), optional.clamps(robot)
    units = []
    for actuator, joint, kind, gear in zip(
        robot.actuators, optional.actuator_joints(robot), robot.command_kinds, optional.gear_ratios(robot), strict=True
    ):
        share = kind == "torque" and is_share(gear, clamps.get(actuator, (0.0, 0.0)))
        units.append("1" if share else sliding_unit(_COMMAND[kind]) if joint in slides else _COMMAND[kind])
    return tuple(units)


def is_share(gear: float, limits: tuple[float, float]) -> bool:
    """Whether the command of a motor is a share of its torque, without a unit: it ends at 1, and the gear makes it a
    torque."""
    return gear != 1.0 and max(map(abs, limits)) == 1.0


def parameter_unit(robot: Robot, knob: Knob) -> str:
    """The unit of a free number: "1" of a ratio, empty of a nominal parameter, whose unit its model file knows."""
    return "" if knob.effect == TUNE else unit_of(robot, knob.term, BY_NAME[knob.effect].parameter(knob.parameter).unit)


def unit_of(robot: Robot, term: Term, unit: str) -> str:
    """The unit of a number of this effect on this robot: what "command unit" and the like are there, and
    what it is on a joint that slides."""
    kinds = robot.command_kinds
    kind = kinds[robot.actuators.index(term.target)] if term.target in robot.actuators else kinds[0]
    if unit == "channel unit":
        unit = "rad" if (term.target or "").startswith(("position.", "pose.theta")) else "rad/s"
    elif unit == "actuator unit":
        unit = "rad/s" if kind == "speed" else "N m"
    elif unit == "command unit":
        unit = _COMMAND[kind]
    elif unit == "command unit/s":
        unit = {"speed": "rad/s^2", "velocity": "rad/s^2", "position": "rad/s", "torque": "N m/s"}[kind]
    return sliding_unit(unit) if _slides(robot, term) else unit


def _slides(robot: Robot, term: Term) -> bool:
    """Whether the effect acts on joints that slide, or on what drives or measures them."""
    slides, kind = optional.sliding(robot), BY_NAME[term.effect].target
    if not slides:
        return False
    if term.target is None:
        reached = optional.actuator_joints(robot) if kind == "actuator" else optional.joints(robot)
        return kind in ("actuator", "joint", "channel") and slides >= set(reached)
    if kind == "actuator":
        return dict(zip(robot.actuators, optional.actuator_joints(robot), strict=True)).get(term.target) in slides
    return term.target.split(".", 1)[-1] in slides
