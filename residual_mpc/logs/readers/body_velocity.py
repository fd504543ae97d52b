"""Convert the body velocity that commands a differential drive, such as `cmd_vel` in ROS, to wheel speeds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from residual_mpc.logs.columns import group
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, hold

LINEAR, ANGULAR = "command.linear", "command.angular"  # m/s forward, rad/s to the left
LEFT, RIGHT = "command.left", "command.right"  # rad/s


def as_wheel_speeds(columns: dict[str, FloatArray], wheels: tuple[float, float] | None) -> dict[str, FloatArray]:
    """The columns of a run, (n,) each, with `command.left` and `command.right` (rad/s) in place of the body velocity.

    Logged wheel commands take precedence. Without the wheels' geometry nothing changes, since a user's own robot may
    have actuators of these names.

    Args:
        wheels: (radius, track width), m.
    """
    if wheels is None or LINEAR not in columns or ANGULAR not in columns:
        return columns
    rest = {name: values for name, values in columns.items() if name not in (LINEAR, ANGULAR)}
    if any(group(name) == "command" for name in rest):
        return rest
    radius, track = wheels
    sent = np.isfinite(columns[LINEAR]) | np.isfinite(columns[ANGULAR])
    v, w = (np.where(sent, hold(columns[name]), np.nan) for name in (LINEAR, ANGULAR))
    return {
        LEFT: (v - 0.5 * track * w) / radius,
        RIGHT: (v + 0.5 * track * w) / radius,
        **rest,
    }


def said_of_wheel_speeds(
    run: str, logged: Mapping[str, FloatArray], columns: Mapping[str, FloatArray], wheels: tuple[float, float] | None
) -> list[Finding]:
    """The wheels (radius, track width; m) used to convert a body velocity, if the run's columns show that one was.

    They have to be those of the base controller, even if these are wrong: they determine the commands to the wheels.
    """
    if wheels is None or LEFT in logged or LEFT not in columns:
        return []
    radius, track = wheels
    text = (
        f"{LINEAR} and {ANGULAR} were converted to the wheel speeds {LEFT} and {RIGHT}, with a wheel radius of "
        f"{radius:.4g} m and a track width of {track:.4g} m; both must be those that the base controller uses"
    )
    return [Finding("info", "body velocity", run, LEFT, None, text)]
