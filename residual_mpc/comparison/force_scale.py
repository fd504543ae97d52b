"""A common factor on all forces, which motion data hardly determine.

Weaker motors and heavier links than modelled leave almost the same error: a robot's motion depends on its forces
relative to its inertias. Where the model of both sets has such a gain, a changed torque, stiffness or mass is known
only up to that factor.
"""

from collections.abc import Sequence

from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Term, Values

FORCES = frozenset({"N", "N m", "N m/rad", "N/m", "N m s/rad", "N s/m", "kg", "kg m^2"})


def force_scales(robot: Robot, values: Values, term: Term) -> tuple[float, ...]:
    """The gains of both sets that scale what a term adds to the forces: of the motors at its joint, or of every motor
    where it acts on all."""
    joints = dict(zip(robot.actuators, optional.actuator_joints(robot), strict=True))
    here = [a for a, joint in joints.items() if term.target in (a, joint)]
    gains = {k.target: v for k, v in values.items() if k.effect == ACTUATOR_GAIN.name and not k.changed and v > 0.0}
    return tuple(v for target, v in gains.items() if target is None or not here or target in here)


def with_force_scales(ci95: tuple[float, float], unit: str, scales: Sequence[float]) -> tuple[float, float]:
    """The interval of a change, widened to where it would lie if the gains stood for heavier or lighter links."""
    if unit not in FORCES:
        return ci95
    ends = [end / scale for end in ci95 for scale in (1.0, *scales)]
    return min(ends), max(ends)
