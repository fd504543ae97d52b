"""What is left, described: a planted cause that no library names, and nothing where there is nothing."""

from collections.abc import Callable

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.remainder.description import describe_remainder
from residual_mpc.diagnosis.remainder.missing_rates import tempered, travelled
from residual_mpc.diagnosis.remainder.records import Rest
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings
from residual_mpc.report.words.rest import rest_sentence

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
PERIOD, FINE = 0.05, 5e-3  # s: between the rows, and of the integration

# (t s, wheel angle rad (2,), wheel speed rad/s (2,)) -> the rims' speeds over what the model has of them (2,)
Cause = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def temperature(seed: int, t: np.ndarray) -> np.ndarray:
    """K above the first, at times t (n,) s: up and down at another pace in each run."""
    return 10.0 * (1.0 + np.sin(0.2 * (1 + seed % 3) * t + seed))


def driven(seed: int, cause: Cause, gust: float = 0.0, hot: float = 0.0) -> Run:
    """A rover whose rims do as the cause says; gust: rad/s of yaw, in bursts at times of each run's own; hot: share
    that both rims lose per K, where the temperature is logged."""
    rng = np.random.default_rng(seed)
    n, every = round(20.0 / FINE), round(PERIOD / FINE)
    t = np.arange(n) * FINE
    frequency, phase = rng.uniform(0.1, 0.4, (3, 2)), rng.uniform(0.0, 6.28, (3, 2))
    wave = 6.0 + 3.0 * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1)
    command = np.repeat(wave[::every], every, axis=0)[:n]
    begins, sizes = rng.uniform(0.0, 19.0, 12), rng.standard_normal(12)
    angle, pose, rows, warmth = rng.uniform(0.0, 6.28, 2), np.zeros(3), [], temperature(seed, t)
    for k in range(n):
        if k % every == 0:
            rows.append(np.concatenate([[t[k]], command[k], pose]))
        left, right = WHEEL_RADIUS * command[k] * cause(t[k], angle, command[k]) * (1.0 - hot * warmth[k])
        angle = angle + FINE * command[k]
        forward, turn = 0.5 * (left + right), (right - left) / TRACK_WIDTH
        turn += gust * float(sizes @ ((t[k] >= begins) & (t[k] < begins + 0.5)))
        pose = pose + FINE * np.array([forward * np.cos(pose[2]), forward * np.sin(pose[2]), turn])
    log = np.array(rows)
    log[:, 3:] += rng.standard_normal((len(log), 3)) * [0.001, 0.001, 0.004]
    names = ("command.left", "command.right", "pose.x", "pose.y", "pose.theta")
    extra = {"temperature.motors": np.round(warmth[::every])} if hot else {}
    return Run(f"run{seed}", log[:, 0], dict(zip(names, log[:, 1:].T, strict=True)), extra_columns=extra)


def described(cause: Cause, gust: float = 0.0, hot: float = 0.0) -> Rest:
    data = build_dataset([driven(seed, cause, gust, hot) for seed in range(1, 6)], [ROVER] * 5, {})
    settings = Settings(1)
    predicted = predict(data, settings)[0]
    rng = np.random.default_rng(0)
    floors = noise_errors(data, settings, rng, 3)
    return describe_remainder(
        data,
        measure_scales(data),
        settings,
        predicted,
        data.y - predicted,
        floors,
        None,
        rng,
        tuning=RemainderSettings(),
    )


def sentence(rest: Rest) -> str:
    return rest_sentence(rest.document())


def test_an_eccentric_wheel_is_found_in_its_angle() -> None:
    rest = described(lambda t, angle, speed: np.array([1.0 + 0.15 * np.sin(angle[0]), 1.0]))
    first = rest.depends[0]
    assert (first.kind, first.of) == ("wheel_angle", "left") and first.share > 0.6 > first.by_chance
    assert "depends on the angle of the left wheel" in sentence(rest) and "eccentric" in sentence(rest)
    # the curve is the wave: 0.15 of the radius, over the track, to both sides
    y = np.array(first.curve.y)
    size = 0.15 * WHEEL_RADIUS / (TRACK_WIDTH if first.curve.component == "yaw" else 2.0)
    assert np.ptp(y) == pytest.approx(2.0 * size, rel=0.25)


def test_motors_that_warm_up_are_found_in_the_time() -> None:
    rest = described(lambda t, angle, speed: np.full(2, 1.0 - 0.2 * np.exp(-t / 5.0)))
    assert rest.depends[0].kind in ("time", "work") and rest.depends[0].form == "speed"
    assert rest.depends[0].curve.y[0] == pytest.approx(-0.2, abs=0.05)
    assert "warm-up" in sentence(rest)


def test_motors_that_the_heat_weakens_are_found_in_the_logged_temperature() -> None:
    rest = described(lambda t, angle, speed: np.ones(2), hot=0.01)
    first = rest.depends[0]
    assert (first.kind, first.of, first.form) == ("logged", "temperature.motors", "speed")
    assert first.share > 0.6 > first.by_chance
    slope = np.polyfit(first.curve.x, first.curve.y, 1)[0]
    assert slope == pytest.approx(-0.01, rel=0.2)
    assert "temperature.motors" in sentence(rest)


def test_turning_that_is_weak_to_one_side_is_found_in_the_turning_rate() -> None:
    def weak(t: float, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        less = 0.2 * max(speed[1] - speed[0], 0.0)
        return 1.0 + np.array([less, -less]) / speed

    rest = described(weak)
    assert rest.depends[0].kind == "turning" and rest.components[0].name == "yaw"
    assert "an asymmetry between the two directions" in sentence(rest)


def test_gusts_depend_on_nothing_that_was_logged() -> None:
    rest = described(lambda t, angle, speed: np.ones(2), gust=0.5)
    assert rest.components[0].name == "yaw" and rest.components[0].share > 0.8
    assert not rest.depends and "depends on no logged quantity" in sentence(rest)


def test_the_way_travelled_does_not_hang_on_where_the_robot_starts() -> None:
    rng = np.random.default_rng(0)
    pose = np.cumsum(rng.normal(0.0, 0.1, (2, 30, 3)), axis=1)
    turn, shift = 0.7, np.array([2.0, -1.0])
    c, s = np.cos(turn), np.sin(turn)
    moved = pose.copy()
    moved[..., :2] = pose[..., :2] @ np.array([[c, s], [-s, c]]) + shift
    moved[..., 2] += turn
    seen = np.ones(pose.shape[:2], dtype=bool)
    assert travelled(moved, seen) == pytest.approx(travelled(pose, seen))


def test_one_window_that_ran_away_counts_no_more_than_the_larger_others() -> None:
    from residual_mpc.diagnosis.remainder.missing_rates import MissingRate

    error = np.ones((20, 8))
    error[3] = 100.0
    m = tempered(
        MissingRate("yaw", "rad/s", error, 0.0, np.ones((20, 8, 5)), np.ones(20, dtype=bool)),
        settings=RemainderSettings(),
    )
    assert m.error[3] == pytest.approx(2.0) and m.error[4] == pytest.approx(1.0)
    assert m.response[3] == pytest.approx(0.02)  # what may explain it is given the same weight
