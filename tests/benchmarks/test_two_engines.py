"""The comparison of the two engines: what a motion covers."""

import pytest

from benchmarks.engines import driven
from plants.wheeled.motions import back_and_forth, constant_yaw_rate


def test_what_a_motion_covers() -> None:
    """The ramp at the start takes half a second; a sine covers 2 / pi of its amplitude."""
    assert driven(constant_yaw_rate(1.0), 20.0) == pytest.approx((0.0, 19.5))
    assert driven(back_and_forth(0.2, 8.0), 16.5) == pytest.approx((0.2 * 16.0 * 2 / 3.14159, 0.0), rel=1e-4)
