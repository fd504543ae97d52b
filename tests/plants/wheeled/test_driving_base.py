"""A robot that drives on contacts, as a nominal model: its pose, its start, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from plants.wheeled.engines.geometry import Geometry
from plants.wheeled.engines.mjcf import mjcf
from residual_mpc.effects.library import LIBRARY
from residual_mpc.errors import BadInput
from residual_mpc.models.contract import check_robot
from residual_mpc.models.load import load_robot
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.robot_file import read_robot_file
from residual_mpc.models.settings import Knob, Settings, assemble

POSE = ("pose.x", "pose.y", "pose.theta")
TWIST = ("twist.x", "twist.y", "twist.theta")


def robot_of(folder: Path, xml: str, pose_body: str | None = "chassis") -> Robot:
    (folder / "robot.xml").write_text(xml)
    line = f'pose_body = "{pose_body}"\n' if pose_body else ""
    (folder / "robot.toml").write_text(f'name = "two"\nplant = "mujoco"\nmodel = "robot.xml"\n{line}')
    return load_robot(read_robot_file(str(folder / "robot.toml")))


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return robot_of(tmp_path_factory.mktemp("robot"), mjcf(Geometry(), 0.002))


def start_of(robot: Robot, **values: float) -> dict[str, np.ndarray]:
    channels = [c for s in robot.states for c in (s.position, s.velocity) if c]
    return {c: np.array([values.get(c.replace(".", "_"), 0.0)]) for c in channels}


def test_it_keeps_the_contract_of_a_robot(robot):
    check_robot(robot, np.random.default_rng(0), size=3.0)


def test_wheels_that_nobody_measured_start_rolling(robot):
    """0.1 m/s at a heading of 2 rad while turning: each wheel's rim speed is the ground speed of its hub."""
    yaw, speed, heading = 0.7, 0.1, 2.0
    start = start_of(
        robot,
        pose_theta=heading,
        twist_x=speed * np.cos(heading),
        twist_y=speed * np.sin(heading),
        twist_theta=yaw,
    )
    drive = Drive(0.002, 0, np.zeros((1, 1, 2)), None, np.zeros(1))
    out = robot.replay(start, drive, Settings(1), ("velocity.left", "velocity.right"))
    rims = np.array([out["velocity.left"][0, 0], out["velocity.right"][0, 0]]) * 0.033
    # the contacts give by 0.02 mm, which makes the rolling radius 0.03 % smaller
    np.testing.assert_allclose(rims, [speed - 0.08 * yaw, speed + 0.08 * yaw], rtol=1e-3)


def test_the_path_does_not_depend_on_where_and_which_way_it_starts(robot):
    drive = Drive(0.002, 0, np.tile([5.0, 3.0], (1, 500, 1)), None, np.zeros(1))
    a = robot.replay(start_of(robot), drive, Settings(1), POSE)
    b = robot.replay(start_of(robot, pose_x=3.0, pose_y=-1.0, pose_theta=7.5), drive, Settings(1), POSE)
    c, s = np.cos(7.5), np.sin(7.5)
    np.testing.assert_allclose(b["pose.x"], 3.0 + c * a["pose.x"] - s * a["pose.y"], atol=1e-5)
    np.testing.assert_allclose(b["pose.y"], -1.0 + s * a["pose.x"] + c * a["pose.y"], atol=1e-5)
    np.testing.assert_allclose(b["pose.theta"], 7.5 + a["pose.theta"], atol=1e-5)  # 7.5 rad: more than a turn


def test_headings_go_on_over_a_whole_turn(robot):
    drive = Drive(0.002, 0, np.tile([-20.0, 20.0], (1, 1500, 1)), None, np.zeros(1))
    theta = robot.replay(start_of(robot), drive, Settings(1), POSE)["pose.theta"][0]
    assert theta[-1] > 4 * np.pi
    assert np.abs(np.diff(theta)).max() < 0.1


def test_twist_is_the_rate_of_the_pose(robot):
    drive = Drive(0.002, 0, np.tile([6.0, 2.0], (1, 400, 1)), None, np.zeros(1))
    out = robot.replay(start_of(robot, pose_theta=1.0), drive, Settings(1), (*POSE, *TWIST))
    for pose, twist in zip(POSE, TWIST, strict=True):
        rate = np.gradient(out[pose][0], 0.002)[200:-1]
        np.testing.assert_allclose(out[twist][0, 200:-1], rate, atol=2e-4)


@pytest.mark.parametrize(
    ("change", "pose_body", "what"),
    [
        (("", ""), None, 'pose_body = "chassis"'),
        (("", ""), "left_wheel", "bodies with a free joint: chassis"),
        (('<freejoint name="base"/>', ""), "chassis", "bodies with a free joint: none"),
        (('type="plane"', 'type="plane" pos="0 0 -100"'), "chassis", "still moves"),
    ],
)
def test_a_base_that_cannot_drive_is_refused(tmp_path, change, pose_body, what):
    with pytest.raises(BadInput) as caught:
        robot_of(tmp_path, mjcf(Geometry()).replace(*change), pose_body)
    assert what in str(caught.value)


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "left", "right", "track"),
    [
        ("wheel_radius", "scale", 1.1, 1.1, 1.1, 1.0),
        ("wheel_radius", "scale", 0.85, 0.85, 0.85, 1.0),
        ("wheel_radius_mismatch", "ratio", 1.05, 1.0, 1.05, 1.0),
        ("track_width", "scale", 1.2, 1.0, 1.0, 1.2),
    ],
)
def test_wheels_of_another_size_and_distance(robot, effect, parameter, value, left, right, track):
    """Against the paper's equation with the other figures, at the wheels' own speeds; the tyres give by 0.1 %."""
    settings = assemble([{Knob(effect, None, parameter): value}], {e.name: robot.slots(e.name) for e in LIBRARY})
    drive = Drive(0.002, 0, np.tile([4.0, 6.0], (1, 750, 1)), None, np.zeros(1))
    wheels = ("velocity.left", "velocity.right")
    out = {c: v[0, -1] for c, v in robot.replay(start_of(robot), drive, settings, (*TWIST, *wheels)).items()}
    rims = 0.033 * left * out[wheels[0]], 0.033 * right * out[wheels[1]]
    expected = [0.5 * (rims[0] + rims[1]), (rims[1] - rims[0]) / (0.16 * track)]
    np.testing.assert_allclose([np.hypot(out["twist.x"], out["twist.y"]), out["twist.theta"]], expected, rtol=0.001)
