"""A sample with a late stamp lies off a fast motion's curve and is no outlier; a jump in the value still is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from run_tables import ARM, WHEELS, arm_run

from residual_mpc.logs.audit import audit
from residual_mpc.logs.jumps import spikes
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import noise_sigma

SIGMA = 3e-4  # rad


def moving(taken: FloatArray, speed: float = 5.0) -> FloatArray:
    """(n,) rad of a joint that reaches about `speed` rad/s, without noise."""
    return np.asarray(speed * (0.2 * np.sin(3.0 * taken) + 0.05 * np.sin(8.0 * taken + 1.0)))


def some(rng: np.random.Generator, n: int, share: float) -> np.ndarray:
    out = rng.uniform(size=n) < share
    out[:4] = out[-4:] = False
    return out


@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0])
@pytest.mark.parametrize("share", [0.01, 0.05, 0.1])
@pytest.mark.parametrize("late", [0.001, 0.002])
def test_late_stamps_are_no_outliers(rate: float, share: float, late: float) -> None:
    rng = np.random.default_rng(1)
    taken = np.arange(4000) / rate
    y = moving(taken) + SIGMA * rng.standard_normal(len(taken))
    late = min(late, 0.8 / rate)
    t = taken + late * some(rng, len(taken), share)
    assert spikes(t, y, noise_sigma(t, y)).sum() <= 1


@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_samples_late_behind_even_stamps_are_no_outliers(rate: float) -> None:
    rng = np.random.default_rng(2)
    t = np.arange(4000) / rate
    y = moving(t - 0.05 / rate * some(rng, len(t), 0.03)) + SIGMA * rng.standard_normal(len(t))
    assert spikes(t, y, noise_sigma(t, y)).sum() <= 1


def test_lost_rows_and_late_stamps(rate: float = 100.0) -> None:
    rng = np.random.default_rng(3)
    taken = np.arange(4000) / rate
    y = moving(taken) + SIGMA * rng.standard_normal(len(taken))
    t = taken + 0.002 * some(rng, len(taken), 0.05)
    kept = rng.uniform(size=len(t)) > 0.03
    assert spikes(t[kept], y[kept], noise_sigma(t[kept], y[kept])).sum() <= 1


@pytest.mark.parametrize("rate", [200.0, 500.0])
def test_samples_stamped_after_a_pause_are_no_outliers(rate: float) -> None:
    """The loop reads, pauses for one to three periods and stamps what it read before: the next sample is on time."""
    rng = np.random.default_rng(6)
    pause = np.where(some(rng, 4000, 0.01), rng.uniform(1.0, 3.0, 4000), 0.0) / rate
    t = np.cumsum(1.0 / rate + pause)
    y = moving(t - pause) + SIGMA * rng.standard_normal(len(t))
    assert spikes(t, y, noise_sigma(t, y)).sum() <= 1


def test_jumps_after_lost_samples_are_still_found() -> None:
    rng = np.random.default_rng(7)
    t = np.arange(4000) / 100.0
    kept = ~some(rng, len(t), 0.03)
    t = t[kept]
    after = np.diff(t, prepend=t[0]) > 0.015
    y = moving(t) + SIGMA * rng.standard_normal(len(t))
    y[after] -= 0.009 * np.sign(np.gradient(y, t)[after])  # as a fast joint stamped a fraction of a period late
    flags = spikes(t, y, noise_sigma(t, y))
    assert (flags & after).sum() >= 0.6 * after.sum()


@pytest.mark.parametrize("clock", ["even", "late", "uneven"])
@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0])
def test_jumps_on_a_moving_robot_are_still_found(clock: str, rate: float) -> None:
    rng = np.random.default_rng(4)
    n = 4000
    taken = np.arange(n) / rate
    if clock == "uneven":
        taken = taken + 0.3 / rate * rng.uniform(-1.0, 1.0, n)
    bad = some(rng, n, 0.02)
    size = rng.choice([-1.0, 1.0], n) * rng.uniform(0.05, 0.3, n)
    y = moving(taken) + SIGMA * rng.standard_normal(n) + np.where(bad, size, 0.0)
    t = taken + min(0.001, 0.5 / rate) * some(rng, n, 0.05) if clock == "late" else taken
    flags = spikes(t, y, noise_sigma(t, y))
    assert (flags & bad).sum() >= 0.9 * bad.sum()
    assert (flags & ~bad).sum() <= 2


def test_a_slow_robot_hides_no_jump_behind_its_stamps() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(4000) / 100.0
    bad = some(rng, len(t), 0.02)
    jump = 12.0 * SIGMA * rng.choice([-1.0, 1.0], len(t))
    y = moving(t, 0.1) + SIGMA * rng.standard_normal(len(t)) + np.where(bad, jump, 0.0)
    flags = spikes(t, y, noise_sigma(t, y))
    assert (flags & bad).sum() >= 0.85 * bad.sum() and (flags & ~bad).sum() <= 2


def late_run(rng: np.random.Generator, name: str, late: float) -> Run:
    """Three fast joints, some of whose stamps are late."""
    taken = np.arange(3000) / 100.0
    t = taken + late * some(rng, len(taken), 0.04)
    columns: dict[str, FloatArray] = {}
    for k, joint in enumerate("abc"):
        columns[f"command.{joint}"] = moving(taken + k)
        columns[f"position.{joint}"] = moving(taken + k - 0.03) + SIGMA * rng.standard_normal(len(t))
    return Run(name, t, columns)


def test_check_says_how_late_stamps_are() -> None:
    rng = np.random.default_rng(6)
    findings = audit([late_run(rng, "run1", 0.0), late_run(rng, "run2", 0.003)], ARM)
    assert not [f for f in findings if f.kind == "spikes"]
    (finding,) = [f for f in findings if f.kind == "late stamps"]
    assert finding.run == "run2" and finding.column == "t"
    assert "about 3 ms earlier" in finding.message.replace("2.9", "3").replace("3.1", "3")


def test_jumps_are_credited_to_the_runs_that_have_them() -> None:
    rng = np.random.default_rng(7)
    runs = [arm_run(rng, f"run{k}") for k in range(3)]
    for run, rows in ((runs[0], [200, 400]), (runs[2], [300, 500, 700])):
        run.columns["position.a"][rows] += 0.4
    (finding,) = [f for f in audit(runs, ARM) if f.kind == "spikes"]
    assert finding.run == "" and finding.row is None
    assert "5 of 3000 samples of position.a" in finding.message
    assert "run0 (2), run2 (3)" in finding.message and "run1" not in finding.message
    (alone,) = [f for f in audit([replace(runs[0]), runs[1]], ARM) if f.kind == "spikes"]
    assert alone.run == "run0" and alone.row == 200 and "2 of 1000 samples" in alone.message


def test_a_speed_that_follows_a_short_command_is_no_outlier() -> None:
    rng = np.random.default_rng(8)
    t = np.arange(1000) / 20.0
    command = 4.0 + np.sin(0.8 * t)
    command[300::200] -= 2.5
    speed = np.concatenate([command[:1], command[:-1]]) + 0.01 * rng.standard_normal(len(t))
    steady = 4.0 + np.sin(0.8 * t)
    columns = {"command.left": command, "command.right": steady, "velocity.left": speed}
    columns["velocity.right"] = steady.copy()
    assert spikes(t, speed, noise_sigma(t, speed)).sum() == 4
    run = Run("run1", t, columns)
    assert not [f for f in audit([run], WHEELS) if f.kind == "spikes"]
    speed[510] += 2.0  # which nothing commanded
    (finding,) = [f for f in audit([run], WHEELS) if f.kind == "spikes" and f.column == "velocity.left"]
    assert finding.row == 510 and "1 of 1000 samples" in finding.message
    columns["velocity.right"] += 0.01 * rng.standard_normal(len(t))
    columns["velocity.right"][301] -= 2.5  # beside a pulse of the other wheel's command
    assert [f.row for f in audit([run], WHEELS) if f.kind == "spikes" and f.column == "velocity.right"] == [301]
