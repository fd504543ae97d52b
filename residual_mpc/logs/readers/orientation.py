"""The heading of an orientation that a log gives as a quaternion, as ROS does."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.columns import QUATERNION
from residual_mpc.logs.run import FloatArray

HEADING = "pose.theta"
LEAST = 1e-12  # squared size below which four numbers are no rotation


def as_heading(columns: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """The columns of a run, (n,) each, with `pose.theta` (rad) in place of `pose.qx` to `pose.qw`.

    The heading about the vertical is atan2(2 (w z + x y), w^2 + x^2 - y^2 - z^2); x and y are 0 where they are not
    logged. A logged heading takes precedence. It is NaN where the four numbers are no rotation.
    """
    x, y, z, w = (columns.get(f"pose.{q}") for q in QUATERNION)
    rest = {name: values for name, values in columns.items() if name not in {f"pose.{q}" for q in QUATERNION}}
    if z is None or w is None or HEADING in rest:
        return rest
    x, y = (np.zeros_like(z) if q is None else q for q in (x, y))
    heading = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return {**rest, HEADING: np.where(x * x + y * y + z * z + w * w > LEAST, heading, np.nan)}
