"""What the firmware of a digital servo does to the inertia of its joint.

It computes a torque once in a period T and holds it, so that the torque is T/2 late on average: -kd dq/dt (t - T/2) is,
to first order in T, -kd dq/dt + kd T/2 d2q/dt2 (a hold of zero order as a delay of half a period; Astrom and
Wittenmark, Computer-Controlled Systems, 1997, section 8.2). The joint then seems to have kd T/2 less rotor inertia. The
stiffness, held likewise, hides friction only where the model's own steps do not hold it as long.
"""

from residual_mpc.effects.body import ARMATURE
from residual_mpc.models.actuator_values import ListsActuators
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Settings

PERIOD = 0.001  # s, of a usual servo's loop


def hidden_inertia(robot: Robot, knob: Knob) -> float:
    """kg m^2 by which the rotor inertia of a joint may be larger than it seems behind its position servo; 0 for other
    numbers and joints. Of an effect on all joints the most."""
    if knob.effect != ARMATURE.name or not isinstance(robot, ListsActuators):
        return 0.0
    servos = (v for v in robot.actuator_values(Settings(1)) if v.kind == "position" and knob.target in (None, v.joint))
    return 0.5 * PERIOD * max((v.damping for v in servos), default=0.0)
