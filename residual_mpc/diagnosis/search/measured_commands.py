"""Effects that cannot act where a measured quantity drives the model in place of a command."""

from collections.abc import Mapping, Sequence

from residual_mpc.effects.library import LIBRARY
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Term

STAGES = ("command", "actuator")  # of the chain, which a measured speed has behind it
QUANTITY = {"position": "positions", "torque": "torques"}  # of an actuator's kind; the others take speeds


def not_commanded(robot: Robot, measured: Sequence[str]) -> Mapping[Term, str]:
    """The hypotheses about commands and actuators that are none on these runs, with the reason.

    measured: actuators whose command is a measured column, see `RobotFile.measured_commands`. What would act on all
    actuators alike is none as soon as one of them is measured.
    """
    driven = dict(zip(robot.actuators, optional.actuator_joints(robot), strict=True))
    kinds = dict(zip(robot.actuators, robot.command_kinds, strict=True))
    why: dict[Term, str] = {}
    for actuator in (a for a in measured if a in driven):
        quantity = QUANTITY.get(kinds[actuator], "speeds")
        reason = f"the measured {quantity} drive the model: these runs have no commands"
        for effect in LIBRARY:
            slots = robot.slots(effect.name) if effect.stage in STAGES else ()
            here = [s for s in (actuator, driven[actuator]) if s in slots]
            if here or slots == (robot.name,):
                why |= {Term(effect.name, target): reason for target in (None, *here)}
    return why
