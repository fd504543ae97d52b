"""A wheel that is not round, on rovers of another simulation that begin each run with another angle of their wheels."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_euler import simulate

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import Diagnosis
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, assemble

ROBOT = DiffDrive("rover", 0.033, 0.16)
AMPLITUDE, SECONDS, RATE = 0.08, 16.0, 30.0  # 1, s, Hz
SIGMA = {"pose.x": 0.001, "pose.y": 0.001, "pose.theta": 0.002}  # m, m, rad


def angle_at(seed: int) -> float:
    """rad: how both wheels stand when the run begins."""
    return float(np.random.default_rng([seed, 9]).uniform(-np.pi, np.pi))


def uneven_run(seed: int, amplitude: float, noise: float = 1.0, delay: float = 0.0, encoders: bool = False) -> Run:
    """A rover whose wheels are alike, with encoders or without, and a localisation that may be late."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(SECONDS * RATE) + 1) / RATE
    frequency, phase = rng.uniform(0.1, 0.4, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    u = 5.0 + (3.0 * np.sin(2 * np.pi * frequency * t[:, None, None] + phase)).sum(axis=1)  # rad/s

    def command(time: float) -> tuple[float, float]:
        k = min(int(time * RATE + 1e-6), len(t) - 1)
        return float(u[k, 0]), float(u[k, 1])

    faults = {"wheel_eccentricity": {"amplitude": amplitude, "phase": angle_at(seed)}}
    times = np.concatenate([t, t[-1] + t[1:4]])
    pose = simulate(command, times, faults, fine=5e-4)
    columns = {"command.left": u[:, 0], "command.right": u[:, 1]}
    for i, (channel, sigma) in enumerate(SIGMA.items()):
        columns[channel] = np.interp(t - delay, times, pose[:, i]) + noise * sigma * rng.standard_normal(len(t))
    for i, wheel in enumerate(("left", "right") if encoders else ()):
        columns[f"velocity.{wheel}"] = np.concatenate([u[:1, i], u[:-1, i]]) + 0.02 * rng.standard_normal(len(t))
    return Run(f"r{seed}", t, columns)


def diagnosed(runs: list[Run]) -> Diagnosis:
    return diagnose(runs, [ROBOT] * len(runs), {}, (), Options(), np.random.default_rng(0)).diagnosis


@pytest.mark.parametrize("encoders", [False, True])
def test_the_angle_is_read_off_the_readings_around_a_window(encoders: bool) -> None:
    run = uneven_run(3, AMPLITUDE, encoders=encoders)
    data = build_dataset([run], [ROBOT], SIGMA)
    u = np.stack([run.columns["command.left"], run.columns["command.right"]], axis=1)
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(u[:-1], axis=0) / RATE])
    at = np.searchsorted(run.t, data.start - 1e-9)
    angle = data.blocks[0].drive.angle
    assert angle is not None
    off = np.angle(np.exp(1j * (angle - turned[at] - angle_at(3))))
    assert np.abs(off).max() < 0.35 and np.sqrt(np.mean(off**2)) < 0.15


def test_a_window_does_not_tell_its_own_angle() -> None:
    """Whatever the readings of a window are, the angle at its start stays, but for the weights of the others."""
    run = uneven_run(3, AMPLITUDE)
    spoilt = dict(run.columns)
    inside = (run.t >= 7.0) & (run.t <= 8.0)
    spoilt["pose.x"] = spoilt["pose.x"] + 0.01 * inside * np.sin(9.0 * run.t)
    before, after = (build_dataset([r], [ROBOT], SIGMA) for r in (run, Run("r3", run.t, spoilt)))
    w = int(np.flatnonzero(before.start == 7.0)[0])
    ours, theirs = (d.blocks[0].drive.angle for d in (before, after))
    assert ours is not None and theirs is not None
    moved = np.abs(ours - theirs).max(axis=1)
    assert moved[w] < 1e-3 < 0.02 < moved.max()


def test_the_true_amplitude_explains_the_log() -> None:
    data = build_dataset([uneven_run(4, AMPLITUDE, noise=0.02)], [ROBOT], SIGMA)
    slots = {"wheel_eccentricity": ROBOT.slots("wheel_eccentricity"), "sensor_delay": ROBOT.slots("sensor_delay")}

    def error(amplitude: float) -> float:
        row = assemble([{Knob("wheel_eccentricity", None, "amplitude"): amplitude}], slots)
        return float(np.sqrt(np.nanmean((data.y - predict(data, row)[0]) ** 2)))

    assert error(AMPLITUDE) < 0.15 * error(0.0)
    assert all(error(f * AMPLITUDE) > 1.5 * error(AMPLITUDE) for f in (0.7, 1.3))
    # a replay that begins earlier, since the readings are late, knows the angle there
    late = build_dataset([uneven_run(4, AMPLITUDE, noise=0.02, delay=0.1)], [ROBOT], SIGMA)
    row = {Knob("wheel_eccentricity", None, "amplitude"): AMPLITUDE, Knob("sensor_delay", None, "delay"): 0.1}
    turns = {Knob("wheel_eccentricity", None, "phase"): float(np.mean(0.1 * 5.0))}
    left = [float(np.sqrt(np.nanmean((late.y - predict(late, assemble([r], slots))[0])[2:] ** 2))) for r in (
        {**row, **turns}, {k: v for k, v in row.items() if k.effect == "sensor_delay"})]  # fmt: skip
    assert left[0] < 0.4 * left[1]


@pytest.mark.slow
@pytest.mark.parametrize("encoders", [False, True])
def test_wheels_that_are_not_round_are_named(encoders: bool) -> None:
    found = diagnosed([uneven_run(k, AMPLITUDE, encoders=encoders) for k in range(4)])
    assert {c.term.effect for c in found.causes} == {"wheel_eccentricity"} and found.verdict == "effects"
    assert {c.term.target for c in found.causes} == {"left", "right"}
    for cause in found.causes:
        numbers = {e.name: e for e in cause.parameters}
        assert abs(numbers["amplitude"].value - AMPLITUDE) < 0.1 * AMPLITUDE
        assert abs(numbers["phase"].value) < 0.3  # counted from the largest radius


def test_round_wheels_leave_no_gap() -> None:
    assert diagnosed([uneven_run(k, 0.0) for k in range(4)]).verdict == "no_gap"


def test_without_a_whole_pose_no_wheel_is_blamed() -> None:
    run = uneven_run(0, AMPLITUDE, encoders=True)
    heading = Run("r0", run.t, {c: y for c, y in run.columns.items() if c not in ("pose.x", "pose.y")})
    space = build_space(build_dataset([heading], [ROBOT], SIGMA), ())
    assert {t.target for t in space.ruled_out if t.effect == "wheel_eccentricity"} == {"left", "right"}
