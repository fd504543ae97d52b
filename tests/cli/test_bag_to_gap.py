"""From a rosbag2 to a gap: `init` finds the topics, and `gap` says what it says of the same run as CSV."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logs.ros_bags import START, Message, imu, joint_state, odometry, twist, write_bag
from oracles.rover_log import ROBOT, rover_run

from residual_mpc.cli.main import main
from residual_mpc.logs.run import FloatArray, Run

RADIUS, TRACK = 0.033, 0.16  # m
LATE = 0.1  # s, two periods
FAULTS = {"command_delay": {"delay": LATE}}


def call(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    """(exit status, stdout, stderr)."""
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def drive() -> Run:
    return rover_run("drive", FAULTS, seconds=20.0, seed=3)


def measured(run: Run) -> dict[str, FloatArray]:
    """Wheel speeds, which follow the command late, and the twist that an odometry makes of them."""
    late = round(LATE / run.period)
    left, right = (np.concatenate([np.zeros(late), run.columns[f"command.{w}"][:-late]]) for w in ("left", "right"))
    theta = run.columns["pose.theta"]
    v, w = 0.5 * RADIUS * (left + right), RADIUS / TRACK * (right - left)
    twist = {"twist.x": v * np.cos(theta), "twist.y": v * np.sin(theta), "twist.theta": w}
    return {**twist, "velocity.left": left, "velocity.right": right}


def messages(run: Run) -> list[Message]:
    """What the robot's computer records: cmd_vel by its receipt, the rest by header stamps a little before theirs."""
    left, right = run.columns["command.left"], run.columns["command.right"]
    seen, theta = measured(run), run.columns["pose.theta"]
    out: list[Message] = []
    for k, t in enumerate(run.t):
        stamp = START + round(t * 1e9)
        v, w = 0.5 * RADIUS * (left[k] + right[k]), RADIUS / TRACK * (right[k] - left[k])
        wheels = [seen["velocity.left"][k], seen["velocity.right"][k]]
        forward, yaw = 0.5 * RADIUS * (wheels[0] + wheels[1]), seen["twist.theta"][k]
        x, y = run.columns["pose.x"][k], run.columns["pose.y"][k]
        out += [
            ("/cmd_vel", stamp, twist(v, w)),
            ("/odom", stamp + 2_000_000, odometry(stamp, x, y, theta[k], forward, yaw)),
            ("/imu/data", stamp + 100_000, imu(stamp + 100_000, theta[k], yaw)),
            ("/joint_states", stamp + 1_000_000, joint_state(
                stamp, ["wheel_left_joint", "wheel_right_joint"], [], wheels)),
        ]  # fmt: skip
    return sorted(out, key=lambda message: message[1])


def write_csv(run: Run, path: Path) -> Path:
    """Every digit, and the columns that the bag holds."""
    columns = {"t": np.round(run.t * 1e9) / 1e9, **run.columns, **measured(run)}
    rows = [",".join(columns)] + [",".join(repr(float(x)) for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_has_the_gap_of_its_csv(storage: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = drive()
    bag, out = write_bag(tmp_path / "drive", messages(run), storage), tmp_path / "rover.toml"
    status, said, guesses = call(capsys, "init", "diff_drive", bag, "--out", out)
    assert status == 0, said + guesses
    assert f"next: residual-mpc gap --robot {out} {bag}" in said
    assert "guess: command.linear = /cmd_vel.linear.x" in guesses
    assert "guess: velocity.left = /joint_states.velocity.wheel_left_joint" in guesses
    assert "note: /odom" not in guesses and "/odom: header stamps, received 2 ms later" in guesses
    text = out.read_text()
    assert f"wheel_radius = {RADIUS}\n" in text and f"track_width = {TRACK}\n" in text  # as its odometry has them
    assert '"pose.x" = "/odom.pose.x"' in text

    (tmp_path / "csv.toml").write_text(ROBOT)
    results: list[dict[str, Any]] = []
    for robot, log in ((out, bag), (tmp_path / "csv.toml", write_csv(run, tmp_path / "drive.csv"))):
        status, said, errors = call(capsys, "gap", "--robot", robot, log, "--json")
        assert status == 0, errors
        results.append(json.loads(said))
    ours, wanted = results
    assert wanted["nominal"] > 0.1 and ours["windows"] == wanted["windows"] == 20
    assert ours["nominal"] == pytest.approx(wanted["nominal"], rel=1e-9)
    assert ours["noise_floor"] == pytest.approx(wanted["noise_floor"], rel=1e-6)
    for channel, figures in wanted["channels"].items():
        for figure in ("nominal", "noise_floor"):
            assert ours["channels"][channel][figure] == pytest.approx(figures[figure], rel=1e-6), (channel, figure)


def test_check_says_what_the_clocks_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "drive", messages(drive()))
    (tmp_path / "rover.toml").write_text(ROBOT)
    status, said, _ = call(capsys, "check", "--robot", tmp_path / "rover.toml", bag)
    assert status == 0
    assert "/cmd_vel: time of receipt (no header)" in said and "topic /imu/data is not used" in said


def test_a_robot_that_nobody_knows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "drive", messages(drive())[:200])
    status, _, errors = call(capsys, "init", "dif_drive", bag, "--out", tmp_path / "a.toml")
    assert status == 2 and "diff_drive" in errors and not (tmp_path / "a.toml").exists()
    (tmp_path / "bare.toml").write_text('name = "rover"\nplant = "diff_drive"\n')
    status, _, errors = call(capsys, "gap", "--robot", tmp_path / "bare.toml", bag)
    assert status == 2 and "wheel_radius" in errors
