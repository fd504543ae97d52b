"""A limit that may be anything is no certain effect."""

import pytest

from residual_mpc.diagnosis.results.causes import _anywhere
from residual_mpc.diagnosis.results.records import Estimate
from residual_mpc.effects.library import BY_NAME


@pytest.mark.parametrize(
    ("effect", "name", "interval", "expected"),
    [
        ("saturation", "limit", (0.8, 1.3), False),
        ("saturation", "limit", (0.05, 1.3), False),  # an upper end is known
        ("saturation", "limit", (0.05, 2.5), True),
        ("torque_speed_limit", "stall_torque", (0.01, 15.0), True),
        ("actuator_gain", "gain", (0.05, 2.5), False),  # no limit
        ("joint_compliance", "damping_ratio", (0.0, 9.0), False),
    ],
)
def test_a_limit_may_be_anything(effect: str, name: str, interval: tuple[float, float], expected: bool) -> None:
    parameter = BY_NAME[effect].parameter(name)
    assert _anywhere(parameter, Estimate(name, 1.0, interval, parameter.unit)) is expected
