"""Whether a model that was written can be a robot's."""

from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.models.model_file import Written, model_in
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Knob, Values
from residual_mpc.models.targets import targets_of


def fitting(written: Written, robot: Robot) -> tuple[Values, bool]:
    """(values, whether flagged samples are left out) of a diagnosis.json or model.json, for this robot.

    Raises BadInput for neither of the two, and where this robot lacks what they name.
    """
    of, values, leaves_out = model_in(written)
    check_fits(values, robot, of, written.where)
    return values, leaves_out


def check_fits(values: Values, robot: Robot, of: str, where: str) -> None:
    """Raises BadInput where an effect, a target or a parameter of the values, which are a model of the robot `of`, is
    none of this robot's; where: the file that they stand in."""
    for knob in values:
        if knob.effect != TUNE and knob.effect not in BY_NAME:
            raise BadInput(
                f"the effect {knob.effect!r} is not installed",
                where,
                "install the package that defines it, in the environment that runs this",
            )
        lacking = _lacking(knob, robot)
        if lacking:
            raise BadInput(
                f"{robot.name} lacks {lacking}",
                where,
                f"the model is of {of}: give the robot file that was used for its diagnosis",
            )


def _lacking(knob: Knob, robot: Robot) -> str:
    """What of a free number the robot does not have; empty where it has all."""
    if knob.effect == TUNE:
        return "" if knob.parameter in robot.nominal() else knob.parameter
    slots = targets_of(robot, knob.effect)
    if not slots or not (knob.target is None or knob.target in slots):
        return f"{knob.effect} on {knob.target or 'the robot'}"
    known = any(p.name == knob.parameter for p in BY_NAME[knob.effect].parameters)
    return "" if known else f"a parameter {knob.parameter} of {knob.effect}"
