"""The unit in which a run states how well a reference was followed."""

from __future__ import annotations

import pytest

from scenarios.own.units import mixed, unit_of


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        (("position.slide",), "m"),
        (("position.slide", "position.elbow"), "rad"),  # one unit for all: that of the joint that turns
        (("position.elbow",), "rad"),
        (("tool.x", "tool.y", "tool.z"), "m"),
        (("pose.x", "pose.y", "pose.theta"), "m"),
    ],
)
def test_an_error_of_a_joint_that_slides_is_in_metres(names: tuple[str, ...], unit: str) -> None:
    assert unit_of(names, frozenset({"slide"})) == unit


def test_metres_beside_radians_are_said_to_count_alike() -> None:
    slides = frozenset({"slide"})
    assert mixed(("position.slide", "position.elbow"), slides) == [
        "the tracking error counts a metre of slide like a radian"
    ]
    assert mixed(("position.slide",), slides) == mixed(("position.elbow",), slides) == []
