"""Force limits of the model that it reaches in the runs, so that the robot's own may be higher."""

from collections.abc import Mapping, Sequence

from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot

REACHED = 0.98  # of a limit, from which a prediction counts as reaching it
MOST_RAISED = 4.0  # times the model's limit, up to which the robot's is looked for
PROBED = (1.25, 1.8)  # multiples of the model's limit that a search tries first


def reached_limit(robot: Robot, references: Mapping[tuple[str, str], float], actuators: Sequence[str]) -> float:
    """The largest of these actuators' limits that the nominal model reaches, N m or N; 0 where it reaches none.

    Args:
        references: "output" of an actuator is the largest force that the nominal model predicts.
    """
    limits = optional.force_limits(robot)
    at = (limits[a] for a in actuators if references.get(("output", a), 0.0) >= REACHED * limits.get(a, float("inf")))
    return max(at, default=0.0)
