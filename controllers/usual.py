"""Default settings: for an arm from its ranges and the limits of its actuators, for a robot that drives from the wheel
speeds that its reference needs."""

from dataclasses import replace

import numpy as np

from controllers.settings import Limits, MpcSettings, Soft, Weights
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from residual_mpc.models import optional

JOINT, TOOL = 0.02, 0.005  # rad (m for a prismatic joint) and m: errors that cost 1
HELD = 100.0  # rad or m: likewise of a joint that is held, which no command moves
SPEED = 2.0  # rad/s (m/s), rate limit of a position servo's command
SWEEP = 0.2  # s, in which the command of a motor or a velocity servo may cross its range
CHANGE = {"position": 0.05, "velocity": 0.1, "torque": 0.05}  # change per sample that costs 1: rad; shares of the range
FAINT = 100.0  # times the range: commands that cost 1, so that commands cost almost nothing
MARGIN = 0.02  # rad or m, distance of the soft limit from the end of a joint's range
PRICE = 1000.0  # per rad or m, for violating it
SPARE = 1.5  # times the fastest wheel speed that the reference needs: what a robot that drives may command at least
PUSH = 100.0  # linear penalty of a force of twice the servo's limit; the quadratic one is half of it


def usual_settings(model: Augmented, fastest: float | None = None) -> MpcSettings:
    """Weights from the range of each command, hard limits on commands and rates, and soft limits on joint positions and
    servo forces, as far as the step states them. For a robot that drives, those of the small rover, with limits and
    weights of commands scaled up where its fastest wheel on the reference, `fastest` (rad/s), leaves less than a third
    of the rover's range.

    Raises BadInput for a step that does not state the range of each command.
    """
    at = model.stepped
    if not at.rates:
        return MpcSettings() if fastest is None else _scaled(MpcSettings(), fastest)
    if len(at.reach) != len(at.commands):
        raise BadInput(
            f"the step of {model.robot.name!r} has the range of {len(at.reach)} of its {len(at.commands)} commands",
            model.robot.name, "state `reach`, a pair (lowest, highest) for each, in its Stepped, or give the settings",
        )  # fmt: skip
    low, high = (np.array(side) for side in zip(*at.reach, strict=True))
    kinds, width = model.robot.command_kinds, np.ptp(np.array(at.reach), axis=1)
    typical = [CHANGE[k] * (1.0 if k == "position" else w) for k, w in zip(kinds, width.tolist(), strict=True)]
    rate = [SPEED if k == "position" else w / SWEEP for k, w in zip(kinds, width.tolist(), strict=True)]
    soft = tuple(
        Soft(c, x + MARGIN, y - MARGIN, PRICE)
        for c, (x, y) in zip(at.poses, at.spans or [(-np.inf, np.inf)] * len(at.poses), strict=True)
        if y - x < 2.0 * np.pi - 1e-9 and y - x > 4.0 * MARGIN
    )
    soft += tuple(
        Soft(f"effort.{a}", -most, most, PUSH / most, PUSH / most**2)
        for a, kind, most in zip(at.commands, kinds, at.strengths or (np.inf,) * len(kinds), strict=True)
        if kind != "torque" and np.isfinite(most)
    )
    resting = {f"position.{name}" for name in optional.held(model.robot)}
    error = (TOOL,) * len(at.outputs) if at.outputs else tuple(HELD if c in resting else JOINT for c in at.poses)
    return MpcSettings(
        weights=Weights(error, tuple((FAINT * width).tolist()), tuple(typical)),
        limits=Limits(tuple(low.tolist()), tuple(high.tolist()), tuple(rate), soft),
    )


def _scaled(rover: MpcSettings, fastest: float) -> MpcSettings:
    """The rover's settings with limits and weights of commands in proportion to SPARE times the fastest command, where
    that is beyond the rover's own."""
    usual = float(np.max(rover.limits.upper))
    most = max(SPARE * fastest, usual)
    times = most / usual
    weights, limits = rover.weights, rover.limits
    return replace(
        rover,
        weights=replace(
            weights, command=float(np.max(weights.command)) * times, change=float(np.max(weights.change)) * times
        ),
        limits=replace(limits, lower=-most, upper=most, rate=float(np.max(limits.rate)) * times),
    )
