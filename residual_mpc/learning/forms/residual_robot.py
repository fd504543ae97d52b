"""A robot with a learned residual, as a robot: replayed, measured and diagnosed like any other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.learning.forms.form import Form
from residual_mpc.learning.forms.registry import form_named
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.protocol import Drive, Merging, Robot, State
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class ResidualRobot:
    """`base` plus `residual`: Real-to-Sim's corrected simulator where base is one. Effects act on the base."""

    base: Robot
    residual: Residual

    @cached_property
    def form(self) -> Form:
        return form_named(self.residual.form)

    @property
    def name(self) -> str:
        return self.base.name

    @property
    def actuators(self) -> tuple[str, ...]:
        return self.base.actuators

    @property
    def command_kinds(self) -> tuple[str, ...]:
        return self.base.command_kinds

    @property
    def wraps(self) -> Robot:
        """See residual_mpc.models.optional.Wrapping."""
        return self.base

    @property
    def states(self) -> tuple[State, ...]:
        return self.base.states

    @property
    def channels(self) -> tuple[str, ...]:
        return self.base.channels

    @property
    def step(self) -> float | None:
        return self.base.step

    def slots(self, effect: str) -> tuple[str, ...]:
        return self.base.slots(effect)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return self.base.bounds(effect, parameter, slot)

    def reference(self, kind: str, slot: str | None) -> float:
        return self.base.reference(kind, slot)

    def nominal(self) -> Mapping[str, float]:
        return self.base.nominal()

    def merged(self, others: "Sequence[Any]") -> "ResidualRobot | None":
        """This robot and others as one, where their bases can be and the residual is the same."""
        if not isinstance(self.base, Merging) or any(o.residual is not self.residual for o in others):
            return None
        whole = self.base.merged([o.base for o in others])
        return None if whole is None else ResidualRobot(whole, self.residual)

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        if not self.residual.output_scale.any():
            return self.base.replay(start, drive, settings, wanted)
        step = self.residual.step
        return self.form.roll(self.base, self.residual, step, start, drive, settings, wanted).nodes


def with_residual(robots: Sequence[Robot], residual: Residual, source: str = "") -> list[Robot]:
    """Each robot with the residual; robots that are one object stay one. Raises BadInput where it is another robot's.

    source: the file, for the message.
    """
    form = form_named(residual.form)
    for robot in dict.fromkeys(robots):
        try:
            inputs, outputs = form.inputs(robot), form.outputs(robot)
        except (AttributeError, KeyError) as error:
            raise BadInput(
                f"a residual of form {form.name} cannot be used with {robot.name}: {error!r}", source
            ) from error
        if form.name != "joint" and not {"pose.x", "pose.y", "pose.theta"} <= {s.position for s in robot.states}:
            raise BadInput(
                f"its residual corrects a planar velocity, and {robot.name} has no pose",
                source,
                f"the residual was learned on {residual.robot}: give that robot's file",
            )
        if (inputs, outputs) != (residual.inputs, residual.outputs):
            raise BadInput(
                f"its residual must have the inputs {', '.join(inputs)} for {robot.name}, "
                f"got {', '.join(residual.inputs)}",
                source,
                f"the residual was learned on {residual.robot}: give that robot's file",
            )
    made = {id(r): ResidualRobot(r, residual) for r in robots}
    return [made[id(r)] for r in robots]
