"""Sizes in another unit than metres are remarked."""

from __future__ import annotations

import pytest

from residual_mpc.models.robot_file import RobotFile, Variant
from residual_mpc.models.wheel_sizes import implausible_sizes


def rover(radius: float, track: float, *variants: Variant) -> RobotFile:
    return RobotFile("r", "diff_drive", parameters={"wheel_radius": radius, "track_width": track}, variants=variants)


@pytest.mark.parametrize(
    ("radius", "track", "said"),
    [
        (0.1, 720.0, "track_width is 720 m, more than 20 m"),
        (40.0, 0.3, "wheel_radius is 40 m, more than 2 m"),
        (0.1, 0.00072, "track_width is 0.00072 m, less than 0.2 times wheel_radius, 0.1 m"),
    ],
)
def test_millimetres_are_remarked(radius: float, track: float, said: str) -> None:
    (finding,) = implausible_sizes(rover(radius, track), ["run"])
    assert finding.severity == "warning" and finding.message == said and "metres are expected" in finding.remedy


def test_usual_sizes_are_not() -> None:
    for radius, track in ((0.033, 0.16), (0.9, 2.5), (0.01, 0.02), (1.5, 8.0)):
        assert implausible_sizes(rover(radius, track), ["run"]) == []
    assert implausible_sizes(RobotFile("r", "diff_drive"), ["run"]) == []


def test_a_variant_is_checked_where_a_run_has_it() -> None:
    robot = rover(0.1, 0.7, Variant("wide_*", {"parameters": {"track_width": 900.0}}))
    assert implausible_sizes(robot, ["usual"]) == []
    assert len(implausible_sizes(robot, ["wide_1", "wide_2"])) == 1
