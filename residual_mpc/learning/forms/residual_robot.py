"""A robot with a learned residual, as a robot: replayed, measured and diagnosed like any other."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.learning.forms.registry import form_named
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings
from residual_mpc.models.wrapped import Replay, Wrapped


def residual_robot(base: Robot, residual: Residual) -> Wrapped:
    """`base` plus `residual`: Real-to-Sim's corrected simulator where base is one. Effects act on the base."""
    return Wrapped(base, _corrected(residual))


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
    corrected = _corrected(residual)  # the same for all, so that robots which can be merged stay so
    made = {id(r): Wrapped(r, corrected) for r in robots}
    return [made[id(r)] for r in robots]


def _corrected(residual: Residual) -> Replay:
    """The replay of a robot with the residual."""
    form = form_named(residual.form)

    def replayed(
        base: Robot, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        if not residual.acts:
            return base.replay(start, drive, settings, wanted)
        return form.roll(base, residual, residual.step, start, drive, settings, wanted).nodes

    return replayed
