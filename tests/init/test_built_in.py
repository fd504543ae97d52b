"""A robot file for the built-in rover, from a log that names and measures things its own way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import rover_run

import residual_mpc as rm
from residual_mpc.init.built_in import draft_built_in
from residual_mpc.init.draft_text import robot_file_text

NAMES = {
    "command.left": "wl_set", "command.right": "wr_set", "velocity.left": "wl_enc", "velocity.right": "wr_enc",
    "pose.x": "mocap_x_mm", "pose.y": "mocap_y_mm", "pose.theta": "mocap_yaw_deg",
}  # fmt: skip


def written(folder: Path, turned: bool = False, lag: float = 0.1) -> Path:
    """turned: the encoders count angles, not speeds; lag: s, of the motors."""
    run = rover_run("one", {"actuator_lag": {"time_constant": lag}}, 20.0, seed=1)
    columns = dict(run.columns)
    for side in ("left", "right"):
        u = columns[f"command.{side}"]
        speed = np.concatenate([[0.0], u[:-1]])
        columns[f"velocity.{side}"] = np.cumsum(speed) * run.period if turned else speed
    columns |= {c: 1e3 * columns[c] for c in ("pose.x", "pose.y")}
    columns["pose.theta"] = np.degrees((columns["pose.theta"] + np.pi) % (2 * np.pi) - np.pi)
    table = {"timestamp": run.t + 37.2, **{name: columns[c] for c, name in NAMES.items()}}
    pd.DataFrame(table).to_csv(folder / "one.csv", index=False)
    return folder / "one.csv"


def test_wheels_places_and_units_are_found(tmp_path: Path) -> None:
    found = draft_built_in("diff_drive", [written(tmp_path)])
    assert {g.what: g.value for g in found.guesses if g.what in NAMES} == NAMES
    assert not [g for g in found.guesses if "base controller" in g.why]  # the wheels are commanded themselves
    factors = {m.column: m.factor for m in found.mends}
    assert factors == pytest.approx({"mocap_yaw_deg": np.pi / 180, "mocap_x_mm": 1e-3, "mocap_y_mm": 1e-3})


def test_encoders_in_radians_are_angles_and_no_speeds(tmp_path: Path) -> None:
    found = draft_built_in("diff_drive", [written(tmp_path, turned=True)])
    roles = {g.value: g.what for g in found.guesses}
    assert (roles["wl_enc"], roles["wr_enc"]) == ("position.left", "position.right")


def test_encoders_that_count_are_not_used_and_said_to_be_such(tmp_path: Path) -> None:
    path = written(tmp_path, turned=True)
    table = pd.read_csv(path)
    table[["wl_enc", "wr_enc"]] *= 2048.0 / (2.0 * np.pi)
    table.to_csv(path, index=False)
    found = draft_built_in("diff_drive", [path])
    assert not {"wl_enc", "wr_enc"} & {g.value for g in found.guesses}
    why = {u.name: u.why for u in found.unmatched}
    assert "times wl_set: possibly an encoder in other units" in why["wl_enc"] and 'as "position.left"' in why["wl_enc"]


def test_speeds_whose_names_say_rpm_are_converted(tmp_path: Path) -> None:
    table = pd.read_csv(written(tmp_path))
    speeds = {"wl_set": "wl_set_rpm", "wr_set": "wr_set_rpm", "wl_enc": "wl_enc_rpm", "wr_enc": "wr_enc_rpm"}
    table[list(speeds)] *= 30.0 / np.pi
    table.rename(columns=speeds).to_csv(tmp_path / "one.csv", index=False)
    found = draft_built_in("diff_drive", [tmp_path / "one.csv"])
    assert {m.column: m.factor for m in found.mends if m.column.endswith("rpm")} == pytest.approx(
        dict.fromkeys(speeds.values(), np.pi / 30.0)
    )
    (radius,) = (g for g in found.guesses if g.what == "parameters.wheel_radius")
    assert float(radius.why.split("about ")[1].split(" m)")[0]) == pytest.approx(WHEEL_RADIUS, rel=0.2)


@pytest.mark.parametrize("fast", [False, True])
def test_angles_of_wheels_in_rad_are_named(tmp_path: Path, fast: bool) -> None:
    """fast: beside their speeds."""
    table = pd.read_csv(written(tmp_path))
    for side in "lr":
        table[f"w{side}_position"] = np.cumsum(table[f"w{side}_enc"]) * 0.02
    table.drop(columns=[] if fast else ["wl_enc", "wr_enc"]).to_csv(tmp_path / "one.csv", index=False)
    found = draft_built_in("diff_drive", [tmp_path / "one.csv"])
    named = {g.what: g.value for g in found.guesses}
    assert named["position.left"] == "wl_position" and named["position.right"] == "wr_position"
    assert ("velocity.left" in named) == fast
    assert not [m for m in found.unmatched if "position" in m.name]


@pytest.mark.parametrize("lag", [0.01, 0.1])
def test_the_motion_hints_at_the_geometry_and_does_not_set_it(tmp_path: Path, lag: float) -> None:
    """The rover of the log is the built-in one, in millimetres and degrees, behind slow motors."""
    found = draft_built_in("diff_drive", [written(tmp_path, lag=lag)])
    for name, value in (("wheel_radius", WHEEL_RADIUS), ("track_width", TRACK_WIDTH)):
        (guess,) = (g for g in found.guesses if g.what == f"parameters.{name}")
        hint = float(guess.why.split("about ")[1].split(" m)")[0])
        assert hint == pytest.approx(value, rel=0.2) and guess.sure == 0.1
        assert found.parameters[name] == float(guess.value)


ROS = {
    "command.linear": "/cmd_vel/linear/x", "command.angular": "/cmd_vel/angular/z",
    "pose.x": "/odom/pose/pose/position/x", "pose.y": "/odom/pose/pose/position/y",
    "pose.qx": "/odom/pose/pose/orientation/x", "pose.qy": "/odom/pose/pose/orientation/y",
    "pose.qz": "/odom/pose/pose/orientation/z", "pose.qw": "/odom/pose/pose/orientation/w",
    "velocity.left": "/joint_states/wheel_left_joint/velocity",
    "velocity.right": "/joint_states/wheel_right_joint/velocity",
}  # fmt: skip


@pytest.mark.parametrize("dots", [False, True])
def test_topics_of_ros_in_one_table(tmp_path: Path, dots: bool) -> None:
    """As a plotting tool exports them: each topic has rows of its own, the command is a body velocity, and the heading
    a quaternion; an IMU has another one."""
    run = rover_run("one", {}, 20.0, seed=1)
    left, right = run.columns["command.left"], run.columns["command.right"]
    columns = {c: run.columns[c] for c in ("pose.x", "pose.y")}
    columns |= {f"velocity.{side}": run.columns[f"command.{side}"] for side in ("left", "right")}
    columns["command.linear"] = 0.5 * WHEEL_RADIUS * (left + right)
    columns["command.angular"] = WHEEL_RADIUS * (right - left) / TRACK_WIDTH
    half = 0.5 * run.columns["pose.theta"]
    columns |= {"pose.qx": 0.0 * half, "pose.qy": 0.0 * half, "pose.qz": np.sin(half), "pose.qw": np.cos(half)}
    names = {
        key: n.replace("/linear", ".linear").replace("/angular", ".angular") if dots else n for key, n in ROS.items()
    }
    table = pd.DataFrame({names[key]: columns[key] for key in ROS})
    for axis, q in zip("xyzw", ("pose.qx", "pose.qy", "pose.qw", "pose.qz"), strict=True):
        table[f"/imu/data/orientation/{axis}"] = columns[q]
    table.insert(0, "__time", 1764313000.0 + run.t)
    sent = table.copy()
    sent["__time"] += 0.004
    measured = [c for c in table if c not in (names["command.linear"], names["command.angular"], "__time")]
    sent[measured] = np.nan
    table[[names["command.linear"], names["command.angular"]]] = np.nan
    pd.concat([table, sent]).sort_values("__time").to_csv(tmp_path / "one.csv", index=False)
    found = draft_built_in("diff_drive", [tmp_path / "one.csv"])
    assert {g.what: g.value for g in found.guesses if g.what in ROS} == names
    assert "pose.theta" not in [m.name for m in found.missing]
    sizes = [g.why for g in found.guesses if g.what.startswith("parameters.")]
    assert len(sizes) == 2 and all("must be the base controller's" in why for why in sizes)
    (tmp_path / "robot.toml").write_text(robot_file_text(found, tmp_path))
    (read,) = rm.read_runs(rm.load_robot(tmp_path / "robot.toml"), tmp_path / "one.csv").runs
    heading = read.columns["pose.theta"][np.isfinite(read.columns["pose.theta"])]
    np.testing.assert_allclose(np.unwrap(heading), np.unwrap(2.0 * half)[-len(heading) :], atol=1e-6)
    assert np.isfinite(read.columns["command.left"]).any()
