"""The unit of a channel follows what its joint does."""

from __future__ import annotations

import pytest

from residual_mpc.report.evidence.channel_units import channel_unit


@pytest.mark.parametrize(
    ("channel", "unit"),
    [
        ("position.elbow", "rad"), ("velocity.elbow", "rad/s"), ("position.lift", "m"), ("velocity.lift", "m/s"),
        ("pose.theta", "rad"), ("pose.x", "m"), ("twist.theta", "rad/s"), ("velocity.left", "rad/s"),
    ],
)  # fmt: skip
def test_a_sliding_joint_is_measured_in_metres(channel: str, unit: str) -> None:
    assert channel_unit(channel, frozenset({"lift"})) == unit
