"""What the wheels' encoders say about a cause that is named for the pose."""

import math
from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.encoder_consistency import contradicted
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import Diagnosis
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
PERIOD, FINE = 0.05, 1e-3  # s: between the rows, and of the integration


def driven(seed: int, ratio: float, gain: float, tau: float) -> Run:
    """A rover with encoders. ratio of the right rim to the left one, behind the encoders; gain of the right motor and
    lag tau (s) of both, before them."""
    rng = np.random.default_rng(seed)
    n, every = round(20.0 / FINE), round(PERIOD / FINE)
    t = np.arange(n) * FINE
    frequency, phase = rng.uniform(0.1, 0.4, (3, 2)), rng.uniform(0.0, 6.28, (3, 2))
    wave = 3.0 * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1)
    command = np.repeat(wave[::every], every, axis=0)[:n]
    left = right = x = y = theta = 0.0  # speeds of the wheels, rad/s, and the pose
    rows = []
    for k, (told_left, told_right) in enumerate(command.tolist()):
        if k % every == 0:
            rows.append([t[k], told_left, told_right, x, y, theta, left, right])
        left += FINE / tau * (told_left - left)
        right += FINE / tau * (gain * told_right - right)
        forward = 0.5 * WHEEL_RADIUS * (left + ratio * right)
        x, y = x + FINE * forward * math.cos(theta), y + FINE * forward * math.sin(theta)
        theta += FINE * WHEEL_RADIUS * (ratio * right - left) / TRACK_WIDTH
    log = np.array(rows)
    log[:, 3:] += rng.standard_normal((len(log), 5)) * [0.001, 0.001, 0.002, 0.03, 0.03]
    names = ("command.left", "command.right", "pose.x", "pose.y", "pose.theta", "velocity.left", "velocity.right")
    return Run(f"run{seed}", log[:, 0], dict(zip(names, log[:, 1:].T, strict=True)))


def said(only: tuple[str, ...], **robot: float) -> Diagnosis:
    runs = [driven(seed, **robot) for seed in (1, 2)]
    return diagnose(runs, [ROVER, ROVER], {}, (), Options(only=only), np.random.default_rng(0)).diagnosis


@pytest.fixture(scope="module")
def weak_motor() -> Diagnosis:
    return said(("wheel_radius_mismatch", "track_width"), ratio=1.0, gain=0.96, tau=0.02)


def test_a_rim_does_not_stand_in_for_a_motor_that_the_encoders_saw(weak_motor: Diagnosis) -> None:
    assert weak_motor.verdict == "unknown" and not weak_motor.causes
    assert any("wheel_radius_mismatch would reduce the gap of the pose" in note for note in weak_motor.notes)


def test_the_motor_itself_is_named() -> None:
    diagnosis = said(("wheel_radius_mismatch", "actuator_gain"), ratio=1.0, gain=0.96, tau=0.02)
    assert [str(c.term) for c in diagnosis.causes] == ["actuator_gain [right]"]
    assert diagnosis.causes[0].parameters[0].value == pytest.approx(0.96, abs=0.01)


def test_a_rim_is_named_though_the_encoders_miss_a_lag_as_well() -> None:
    diagnosis = said(("wheel_radius_mismatch",), ratio=1.12, gain=1.0, tau=0.06)
    assert [str(c.term) for c in diagnosis.causes] == ["wheel_radius_mismatch"]
    assert diagnosis.verdict == "partial"
    assert diagnosis.causes[0].parameters[0].value == pytest.approx(1.12, abs=0.02)


def test_a_motor_does_not_stand_in_for_a_rim_that_the_encoders_did_not_see() -> None:
    """With both rims smaller and the left motor faster the pose would be right, and the left encoder wrong."""
    diagnosis = said(("wheel_radius", "actuator_gain"), ratio=0.82, gain=1.0, tau=0.02)
    assert diagnosis.verdict in ("partial", "unknown")
    assert "actuator_gain" not in [c.term.effect for c in diagnosis.causes]


def test_motors_that_deviate_differently_are_denied_one_by_one() -> None:
    """A slower left and a faster right motor on larger wheels move the pose as a larger right wheel does."""
    diagnosis = said(("wheel_radius", "actuator_gain"), ratio=1.09, gain=1.0, tau=0.02)
    assert diagnosis.verdict in ("partial", "unknown")
    assert "actuator_gain" not in [c.term.effect for c in diagnosis.causes]


def test_an_effect_is_denied_by_the_wheels_that_it_turns() -> None:
    """The left wheel's own error says nothing of the right motor."""
    runs = [driven(seed, ratio=1.0, gain=1.0, tau=0.02) for seed in (1, 2)]
    data = build_dataset(runs, [ROVER, ROVER], dict.fromkeys(runs[0].columns, 0.01))
    data = replace(data, compared=np.array([c.startswith("pose") for c in data.channels])[None].repeat(data.count, 0))
    left, right = (Knob("actuator_gain", side, "gain") for side in ("left", "right"))
    both: Values = {left: 0.93, right: 1.02}
    space = build_space(data, ())
    after, *less = predict(data, space.settings([both, {right: 1.02}, {left: 0.93}]))
    assert contradicted(data, after, np.stack(less), settings=DataSettings()).tolist() == [True, True]
    true, *none = predict(data, space.settings([{}, {left: 1.03}, {right: 1.03}]))
    assert contradicted(data, true, np.stack(none), settings=DataSettings()).tolist() == [False, False]
