"""The values of a diagnosis as a replay takes them, with the sizes of effects in groups of windows."""

from collections.abc import Sequence

from residual_mpc.diagnosis.predict.group_space import Sizes, in_groups
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Knob, Settings, Values, assemble
from residual_mpc.models.targets import Targets


def settings_in_groups(robot: Robot, hypotheses: Sequence[Values], groups: Sequence[Sizes]) -> Settings:
    """One row per hypothesis, with these sizes in the groups 1, 2, ... of windows (see `Block`)."""
    slots = Targets(robot)

    def bounds(knob: Knob) -> tuple[float, float]:
        return robot.bounds(knob.effect, knob.parameter, knob.target)

    return in_groups(hypotheses, groups, lambda some: assemble(some, slots), bounds)
