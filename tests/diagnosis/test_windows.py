"""Where windows start, and what stands in them."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset, window_starts
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)


def run_of(length: float, period: float = 0.1, begin: float = 0.0) -> Run:
    t = begin + period * np.arange(round(length / period) + 1)
    return Run("run", t, {})


@pytest.mark.parametrize(
    ("length", "count"),
    [
        (3.0, 3),
        (2.9, 3),  # the last stamp is one period before the third window's end
        (2.8, 2),
        (3.7, 3),  # a shorter remainder is dropped
        (1.0, 1),
        (0.9, 1),
        (0.4, 1),  # shorter than the horizon: one window
        (0.1, 1),
    ],
)
def test_windows_of_a_run(length: float, count: int) -> None:
    np.testing.assert_allclose(window_starts(run_of(length, begin=17.3), 1.0), 17.3 + np.arange(count))


@pytest.mark.parametrize("horizon", [0.1, 0.25, 0.3, 2.0])
def test_windows_follow_the_horizon(horizon: float) -> None:
    starts = window_starts(run_of(6.0), horizon)
    assert len(starts) == int((6.0 + 0.1) / horizon + 1e-9)
    np.testing.assert_allclose(np.diff(starts), horizon)


def test_large_time_stamps_lose_no_window() -> None:
    begin = 1.7e9  # a clock since 1970
    assert len(window_starts(run_of(10.0, begin=begin), 1.0)) == 10


def test_what_a_window_holds() -> None:
    run = rover_run("one", {}, 3.0, seed=1)
    data = build_dataset([run], [ROVER], SIGMA)
    assert data.count == 3 and data.skipped == 0 and data.channels == ("pose.theta", "pose.x", "pose.y")
    np.testing.assert_allclose(data.t[1], 0.05 * np.arange(21), atol=1e-9)
    np.testing.assert_array_equal(data.y[1, :, 1], run.columns["pose.x"][20:41])
    (block,) = data.blocks
    assert block.drive.command.shape[0] == 3 and block.drive.enabled is None
    np.testing.assert_allclose(block.drive.clock, [0.0, 1.0, 2.0])


def test_commands_are_held_until_the_next_that_is_not_missing() -> None:
    run = rover_run("one", {}, 3.0, seed=1)
    gappy = run.columns["command.left"].copy()
    gappy[21:25] = np.nan  # 1.05 to 1.2 s: the command of 1.0 s holds
    data = build_dataset([Run("one", run.t, {**run.columns, "command.left": gappy})], [ROVER], SIGMA)
    drive = data.blocks[0].drive
    sent = drive.command[1, drive.lead :, 0]
    np.testing.assert_allclose(sent[: round(0.25 / drive.dt)], run.columns["command.left"][20], atol=1e-9)


def test_before_the_first_stamp_the_first_command_was_held_unless_the_wheel_was_measured() -> None:
    run = rover_run("one", {}, 3.0, seed=1)
    drive = build_dataset([run], [ROVER], SIGMA).blocks[0].drive
    np.testing.assert_allclose(drive.command[0, : drive.lead, 0], run.columns["command.left"][0], atol=1e-9)
    standing = {**run.columns, "velocity.left": np.concatenate([[0.0], run.columns["command.left"][:-1]])}
    drive = build_dataset([Run("one", run.t, standing)], [ROVER], SIGMA).blocks[0].drive
    np.testing.assert_allclose(drive.command[0, : drive.lead, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(drive.command[0, : drive.lead, 1], run.columns["command.right"][0], atol=1e-9)


def test_an_actuator_that_is_off_is_off_in_the_replay() -> None:
    run = rover_run("one", {}, 2.0, seed=1)
    on = np.ones(len(run.t))
    on[10:20] = 0.0
    data = build_dataset([Run("one", run.t, {**run.columns, "enabled.left": on})], [ROVER], SIGMA)
    enabled = data.blocks[0].drive.enabled
    assert enabled is not None and (enabled[1] == 1).all() and (enabled[..., 1] == 1).all()
    assert np.mean(enabled[0, :, 0] == 0) == pytest.approx(0.5, abs=0.02)


def test_some_windows_taken() -> None:
    data = build_dataset([rover_run("one", {}, 4.0), rover_run("two", {}, 3.0, seed=2)], [ROVER, ROVER], SIGMA)
    keep = np.array([0, 1, 1, 0, 1, 0, 1], dtype=bool)
    few = data.take(keep)
    assert few.count == 4 and few.blocks[0].drive.command.shape[0] == 4
    np.testing.assert_array_equal(few.start, data.start[keep])
    np.testing.assert_array_equal(few.y, data.y[keep])
    np.testing.assert_array_equal(few.blocks[0].drive.clock, data.blocks[0].drive.clock[keep])


def test_equal_robots_of_two_variants_lose_no_run() -> None:
    """Two settings of a rover may differ in nothing that its model sees."""
    twin = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
    runs = [rover_run("one", {}, 3.0), rover_run("two", {}, 3.0, seed=2)]
    assert build_dataset(runs, [ROVER, twin], SIGMA).count == 6


def test_no_window_with_a_start_is_an_error() -> None:
    run = rover_run("one", {}, 1.0)
    late = run.columns["pose.x"].copy()
    late[:-1] = np.nan
    with pytest.raises(BadInput, match="none of 1 windows"):
        build_dataset([Run("one", run.t, {**run.columns, "pose.x": late})], [ROVER], SIGMA)
