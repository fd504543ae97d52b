"""Stamps that vary although the samples were taken evenly are told from samples that were taken unevenly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import residual_mpc as rm
from residual_mpc.logs.even_clock import even_clock, ticks
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.sampling_times import with_sampling_times

SIGMA = 3e-4  # rad


def moving(t: FloatArray) -> FloatArray:
    """(n,) rad at times t (n,) s: up to 1.4 rad/s."""
    return np.asarray(0.3 * np.sin(2.5 * t) + 0.1 * np.sin(7.0 * t + 1.0))


def logged(
    name: str, rate: float, sampled: float, stamped: float, seed: int, seconds: float = 20.0, speed: float = 1.0
) -> tuple[Run, FloatArray]:
    """A run whose sampling and whose stamps vary by these shares of the period, 1-sigma, with a fiftieth of its rows
    lost and a command in every row; and the times (n,) s at which its samples were taken, from its first stamp."""
    rng = np.random.default_rng(seed)
    n = int(seconds * rate)
    shift = np.clip(rng.standard_normal((2, n)), -2.4, 2.4)
    taken = (np.arange(n) + sampled * shift[0]) / rate
    stamps = np.maximum.accumulate(taken + stamped * shift[1] / rate)
    y = speed * moving(taken) + SIGMA * rng.standard_normal(n)
    kept = (rng.uniform(size=n) > 0.02) & (np.diff(stamps, prepend=-1.0) > 0.0)
    t, taken, y = stamps[kept], taken[kept], y[kept]
    columns = {"command.j": y.copy(), "position.j": y}
    return Run(name, t - t[0], columns), taken - t[0]


def off(run: Run, taken: FloatArray) -> float:
    """s, 1-sigma of a run's times about those at which the samples were taken, less a common shift."""
    return float(np.std(run.t - taken))


@pytest.mark.parametrize("rate, stamped", [(25.0, 0.06), (25.0, 0.15), (100.0, 0.06), (100.0, 0.15), (500.0, 0.15)])
def test_samples_taken_evenly_are_dated_evenly(rate: float, stamped: float) -> None:
    run, taken = logged("a", rate, 0.0, stamped, seed=1, seconds=60.0)
    (mended,), findings = with_sampling_times([run])
    assert [f.kind for f in findings] == ["uneven stamps"]
    assert off(mended, taken) < 0.3 * off(run, taken)
    assert mended.columns is run.columns


@pytest.mark.parametrize("rate", [25.0, 100.0, 500.0])
@pytest.mark.parametrize("sampled", [0.06, 0.15])
def test_samples_taken_unevenly_keep_their_stamps(rate: float, sampled: float) -> None:
    run, _ = logged("a", rate, sampled, 0.0, seed=2, seconds=60.0)
    assert with_sampling_times([run]) == ((run,), ())


def test_speeds_that_follow_held_commands_do_not_speak_against_the_stamps() -> None:
    """A wheel that reaches its command within a row is as smooth over the rows as its commands are; the pose tells."""
    run, taken = logged("a", 20.0, 0.06, 0.0, seed=10, seconds=60.0)
    rng = np.random.default_rng(11)
    commanded = 3.0 * moving(np.arange(len(taken)) / 20.0) + 3e-4 * rng.standard_normal(len(taken))
    pose = np.concatenate([[0.0], np.cumsum(commanded[:-1] * np.diff(taken))]) + SIGMA * rng.standard_normal(len(taken))
    columns = {"command.left": commanded, "velocity.left": commanded, "pose.theta": pose}
    alone = replace(run, columns={c: columns[c] for c in ("command.left", "velocity.left")})
    assert with_sampling_times([alone])[1]  # what the speed by itself seems to say
    both = replace(run, columns=columns)
    assert with_sampling_times([both]) == ((both,), ())


def test_joints_that_show_the_command_of_the_row_before_keep_their_stamps() -> None:
    """The loop is uneven and its stamps are right, but an even clock is nearer to the stamps of the rows before."""
    run, taken = logged("a", 40.0, 0.08, 0.0, seed=8, seconds=60.0)
    rng = np.random.default_rng(9)
    shown = moving(taken - np.diff(taken, prepend=-0.025)) + SIGMA * rng.standard_normal(len(taken))
    late = replace(run, columns={**run.columns, "position.j": shown})
    assert with_sampling_times([late]) == ((late,), ())


def test_where_both_vary_the_error_falls() -> None:
    run, taken = logged("a", 100.0, 0.08, 0.16, seed=3, seconds=60.0)
    (mended,), (finding,) = with_sampling_times([run])
    assert off(mended, taken) < 0.7 * off(run, taken)
    assert "25% of this variation" in finding.message


def test_stamps_whose_errors_the_noise_hides_stay() -> None:
    run, _ = logged("a", 500.0, 0.0, 0.06, seed=1)  # 0.17 mrad at the most
    assert with_sampling_times([run])[0][0] is run


def test_even_stamps_stay() -> None:
    run, _ = logged("a", 100.0, 0.0, 0.005, seed=4)
    assert with_sampling_times([run])[0][0] is run


def test_a_run_that_does_not_tell_follows_the_others() -> None:
    fast, _ = logged("fast", 100.0, 0.0, 0.15, seed=5)
    slow, taken = logged("slow", 100.0, 0.0, 0.15, seed=6, speed=0.003)
    assert with_sampling_times([slow])[0][0] is slow
    (_, mended), (finding,) = with_sampling_times([fast, slow])
    assert off(mended, taken) < 0.3 * off(slow, taken)
    assert finding.run == "" and finding.message.startswith("in 2 of 2 runs the time stamps vary by up to")


def test_it_does_not_where_one_was_sampled_as_stamped() -> None:
    fast, _ = logged("fast", 100.0, 0.0, 0.15, seed=5)
    other, _ = logged("other", 100.0, 0.15, 0.0, seed=7)
    slow, _ = logged("slow", 100.0, 0.0, 0.15, seed=6, speed=0.003)
    runs, findings = with_sampling_times([fast, other, slow])
    assert runs[1] is other and runs[2] is slow
    assert [f.run for f in findings] == ["fast"]


def test_tables_are_read_so(tmp_path: Path) -> None:
    """Uneven stamps and lost rows together, through what every command reads with."""
    rng = np.random.default_rng(11)
    k = np.arange(2000)[rng.uniform(size=2000) > 0.02]
    t = np.maximum.accumulate(0.02 * k + 0.003 * rng.standard_normal(len(k)))
    table = {"t": t, "command.left": np.sin(0.05 * k), "command.right": np.cos(0.05 * k)}
    table |= {"pose.x": moving(0.02 * k), "pose.y": moving(0.02 * k + 1.0), "pose.theta": 0.1 * moving(0.02 * k)}
    pd.DataFrame(table).drop_duplicates("t").to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "robot.toml").write_text(
        'name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.03\ntrack_width = 0.2\n'
    )
    robot = rm.load_robot(tmp_path / "robot.toml")
    (run,) = runs = rm.read_runs(robot, tmp_path / "run.csv")
    assert {"uneven stamps", "lost rows"} <= {f.kind for f in runs.findings}
    assert len(run.t) == 2000 - k[0] - (1999 - k[-1]) and np.std(np.diff(run.t)) < 0.001
    assert np.isfinite(run.columns["command.left"]).all() and np.isnan(run.columns["pose.x"]).sum() > 20
    found = [f.message for f in rm.check(robot, tmp_path / "run.csv").findings]
    assert any("an even clock, which replaces them" in m for m in found)


def test_noise_alone_says_nothing() -> None:
    run, _ = logged("a", 100.0, 0.0, 0.15, seed=8, speed=0.0)
    assert with_sampling_times([run])[0][0] is run


def test_samples_that_repeat_the_last_one_now_and_then_say_nothing_and_the_others_do() -> None:
    """As from a driver that misses an update of its sensor now and then; such a row looks stamped late."""
    run, taken = logged("a", 100.0, 0.0, 0.15, seed=11, seconds=60.0)
    y, rng = run.columns["position.j"].copy(), np.random.default_rng(12)
    for row in 1 + np.flatnonzero(rng.uniform(size=len(y) - 1) < 0.12):
        y[row] = y[row - 1]
    run = replace(run, columns={**run.columns, "position.j": y})
    (mended,), _ = with_sampling_times([run])
    assert off(mended, taken) < 0.3 * off(run, taken)


def test_a_late_stamp_is_no_lost_row_and_a_lost_row_is_a_tick() -> None:
    """Stamps late by more than half a period now and then, as of a program that stamps what arrives."""
    rng = np.random.default_rng(13)
    taken = 0.01 * np.arange(6000)
    late = rng.exponential(0.0015, len(taken))
    stamps = np.maximum.accumulate(taken + late)
    assert (late > 0.006).sum() > 50
    for kept in (np.ones(len(taken), dtype=bool), rng.uniform(size=len(taken)) > 0.01):
        kept[[0, -1]] = True
        counted, _ = ticks(stamps[kept], 0.01)
        assert counted[-1] == len(taken) - 1
        even = even_clock(stamps[kept], 0.01)
        assert np.std(even - taken[kept]) < 0.3 * np.std(stamps[kept] - taken[kept])


def test_a_slower_sensor_says_nothing() -> None:
    run, _ = logged("a", 100.0, 0.0, 0.15, seed=9)
    slower = run.columns["position.j"].copy()
    slower[np.arange(len(slower)) % 3 != 0] = np.nan
    run = replace(run, columns={**run.columns, "position.j": slower})
    assert with_sampling_times([run])[0][0] is run


def test_the_clock_drifts_with_the_samples_and_starts_again_after_a_pause() -> None:
    rng = np.random.default_rng(10)
    k = np.arange(2000)
    taken = 0.01 * k + 2e-8 * k**2 + np.where(k < 900, 0.0, 0.734)
    stamps = taken + 0.0012 * rng.standard_normal(len(k))
    even = even_clock(stamps, float(np.median(np.diff(stamps))))
    assert np.std(even - taken) < 3e-4
    assert even[[0, -1]] == pytest.approx(stamps[[0, -1]], abs=1e-12)
