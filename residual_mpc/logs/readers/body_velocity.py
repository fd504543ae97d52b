"""Convert the body velocity that commands a differential drive, such as `cmd_vel` in ROS, to wheel speeds."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.columns import group
from residual_mpc.logs.run import FloatArray, hold

LINEAR, ANGULAR = "command.linear", "command.angular"  # m/s forward, rad/s to the left


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
        "command.left": (v - 0.5 * track * w) / radius,
        "command.right": (v + 0.5 * track * w) / radius,
        **rest,
    }
