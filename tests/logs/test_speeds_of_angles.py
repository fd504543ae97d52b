"""Encoder angles of a robot whose model predicts wheel speeds are compared as speeds, neither early nor late."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import residual_mpc as rm
from residual_mpc.logs.run import Run
from residual_mpc.logs.speeds_of_angles import with_speeds_of_angles

CHANNELS = ("velocity.left", "velocity.right", "pose.theta")


def rolling(wrapped: bool = False, jitter: float = 0.0, every: int = 1) -> tuple[Run, np.ndarray]:
    """A wheel at 3 + 2 sin(2 t) rad/s, 10 s at 50 Hz, and its speed; every: samples for which its encoder holds."""
    rng = np.random.default_rng(0)
    t = (np.arange(500) + jitter * rng.uniform(-0.4, 0.4, 500)) / 50.0
    t -= t[0]
    angle = 3.0 * t - np.cos(2.0 * t)
    angle = angle[np.arange(500) // every * every]
    if wrapped:
        angle = np.mod(angle, 2.0 * np.pi)
    columns = {"command.left": np.ones(500), "position.left": angle}
    return Run("r", t, columns), 3.0 + 2.0 * np.sin(2.0 * t)


@pytest.mark.parametrize("jitter", [0.0, 1.0])
@pytest.mark.parametrize("wrapped", [False, True])
def test_speeds_are_those_at_the_stamps(wrapped: bool, jitter: float) -> None:
    run, speed = rolling(wrapped, jitter)
    (moved,), (finding,) = with_speeds_of_angles([run], [CHANNELS])
    got = moved.columns["velocity.left"]
    assert "position.left" not in moved.columns and finding.column == "position.left"
    assert np.isnan(got[[0, -1]]).all()
    assert np.abs(got - speed)[1:-1].max() < 2e-3  # of a difference that ends at the stamp: 0.04


def test_a_slower_encoder_has_fewer_speeds() -> None:
    run, speed = rolling(every=5)
    (moved,), _ = with_speeds_of_angles([run], [CHANNELS])
    got = moved.columns["velocity.left"]
    assert np.isfinite(got).sum() == 98
    assert np.nanmax(np.abs(got - speed)) < 0.02


def test_what_is_predicted_or_measured_stays() -> None:
    run, speed = rolling()
    assert with_speeds_of_angles([run], [("position.left", "velocity.left")]) == ((run,), ())
    both = Run("r", run.t, {**run.columns, "velocity.left": speed})
    assert with_speeds_of_angles([both], [CHANNELS]) == ((both,), ())


def test_a_counter_starts_again_after_several_turns() -> None:
    run, speed = rolling()
    counter = replace(run, columns={**run.columns, "position.left": np.mod(run.columns["position.left"], 16.0)})
    (moved,), _ = with_speeds_of_angles([counter], [CHANNELS])
    assert np.nanmax(np.abs(moved.columns["velocity.left"] - speed)) < 2.0  # the range is known to a sample's way


def test_a_speed_that_serves_as_a_command_stays() -> None:
    run, speed = rolling()
    served = Run("r", run.t, {**run.columns, "velocity.left": speed}, frozenset({"velocity.left"}))
    assert with_speeds_of_angles([served], [CHANNELS]) == ((served,), ())


def test_a_rover_with_encoder_angles_alone(tmp_path: Path) -> None:
    t = np.arange(0.0, 20.0, 0.02)
    command = 4.0 * np.sign(np.sin(0.9 * t))
    speed = np.zeros_like(t)
    for i in range(1, len(t)):  # a motor of 0.15 s, in exact steps
        speed[i] = command[i - 1] + (speed[i - 1] - command[i - 1]) * np.exp(-0.02 / 0.15)
    angle = np.concatenate([[0.0], np.cumsum(0.02 * 0.5 * (speed[1:] + speed[:-1]))])
    table = np.column_stack([t, command, command, angle, angle])
    head = "t,command.left,command.right,position.left,position.right"
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=head, comments="")
    runs = rm.read_runs(rm.load_robot("diff_drive"), tmp_path / "run.csv")
    assert runs[0].measured == ("velocity.left", "velocity.right")
    assert [f.kind for f in runs.findings if f.column == "position.left"] == ["speeds of angles"]
