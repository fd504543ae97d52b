"""A differential drive that is commanded by the velocity of its body, as `cmd_vel` does in ROS."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.columns import group
from residual_mpc.logs.run import FloatArray, hold

LINEAR, ANGULAR = "command.linear", "command.angular"  # m/s forward, rad/s to the left


def as_wheel_speeds(columns: dict[str, FloatArray], wheels: tuple[float, float] | None) -> dict[str, FloatArray]:
    """The columns of a run, (n,) each, with `command.left` and `command.right` in place of the body's velocity.

    Wheel speeds that were logged themselves take precedence. Without the wheels' geometry nothing changes: a robot of
    the user's own may have actuators of these names.

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
