"""Laws of what one channel says about its sensor."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.logs.jumps import spikes
from residual_mpc.logs.run import FloatArray
from residual_mpc.logs.signals import fresh_samples, noise_sigma, resolution, unwrap_with_gaps

T = 0.02 * np.arange(4000)
MOTIONS = {
    "still": np.zeros_like(T),
    "sine": np.sin(np.pi * T),
    "chirp": np.sin(2.0 * np.pi * (0.1 + 0.02 * T) * T),
    "triangle": np.abs(T % 1.0 - 0.5),
    "steps": np.sign(np.sin(np.pi * T)),
    "fast": np.sin(10.0 * np.pi * T),
}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_unwrapping_undoes_wrapping_and_steps_over_gaps(rng: np.random.Generator) -> None:
    angle = np.cumsum(0.3 * rng.standard_normal(500))
    wrapped = (angle + np.pi) % (2.0 * np.pi) - np.pi
    wrapped[rng.uniform(size=500) < 0.2] = np.nan
    out = unwrap_with_gaps(wrapped)
    assert np.array_equal(np.isnan(out), np.isnan(wrapped))
    difference = (out - angle)[np.isfinite(out)]
    assert np.ptp(difference) < 1e-9


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("sigma", [0.001, 0.05])
def test_white_noise_is_measured_through_motion(motion: str, sigma: float, rng: np.random.Generator) -> None:
    y = MOTIONS[motion] + sigma * rng.standard_normal(len(T))
    assert noise_sigma(T, y) == pytest.approx(sigma, rel=0.15)


def test_noise_needs_no_even_stamps_and_no_full_column(rng: np.random.Generator) -> None:
    t = np.cumsum(0.02 * (1.0 + 0.4 * rng.uniform(-1.0, 1.0, len(T))))
    y = np.sin(3.0 * t) + 0.002 * rng.standard_normal(len(t))
    y[rng.uniform(size=len(t)) < 0.1] = np.nan
    assert noise_sigma(t, y) == pytest.approx(0.002, rel=0.1)
    assert noise_sigma(t, np.full(len(t), np.nan)) == 0.0
    assert noise_sigma(t, np.sin(3.0 * t)) < 1e-6


def test_a_slower_sensor_is_found_and_its_noise_not_diluted(rng: np.random.Generator) -> None:
    y = np.repeat(np.sin(np.pi * T[::4]) + 0.01 * rng.standard_normal(1000), 4)
    assert fresh_samples(y).mean() == pytest.approx(0.25, abs=0.01)
    assert noise_sigma(T, y) == pytest.approx(0.01, rel=0.15)


def test_a_sensor_a_little_slower_than_its_log() -> None:
    y = np.interp(np.floor(T * 40.0) / 40.0, T, MOTIONS["sine"])
    assert fresh_samples(y).mean() == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_a_sensor_at_full_rate_is_fresh_throughout(motion: str, step: float) -> None:
    y = MOTIONS[motion] if step == 0.0 else np.round(MOTIONS[motion] / step) * step
    assert fresh_samples(y).all()
    y = y.copy()
    y[::5] = np.nan
    assert np.array_equal(fresh_samples(y), np.isfinite(y))


@pytest.mark.parametrize("step", [0.0015339808, 0.1, 2e-4])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_the_step_of_a_quantised_channel(step: float, kind: type, rng: np.random.Generator) -> None:
    smooth = MOTIONS["chirp"] + 0.003 * rng.standard_normal(len(T))
    y = (np.round(smooth / step) * step).astype(kind).astype(np.float64)
    assert resolution(y) == pytest.approx(step, rel=1e-3)
    assert noise_sigma(T, y) >= step / np.sqrt(12.0) * 0.99


def test_no_step_where_there_is_none(rng: np.random.Generator) -> None:
    for n in (5, 40, 400, 4000):
        y = rng.standard_normal(n)
        assert resolution(y) == 0.0
        assert resolution(y.astype(np.float32).astype(np.float64)) == 0.0
    assert resolution(np.ones(10)) == resolution(np.full(3, np.nan)) == 0.0


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("sigma", [0.002, 0.02])
def test_motion_is_no_spike(motion: str, sigma: float, rng: np.random.Generator) -> None:
    y = MOTIONS[motion] + sigma * rng.standard_normal(len(T))
    assert spikes(T, y, noise_sigma(T, y)).sum() <= 1


@pytest.mark.parametrize(("motion", "found"), [("still", 0.97), ("sine", 0.97), ("triangle", 0.95), ("steps", 0.8)])
@pytest.mark.parametrize("rate", [0.005, 0.03, 0.08])
def test_spikes_are_found(motion: str, found: float, rate: float, rng: np.random.Generator) -> None:
    y = MOTIONS[motion] + 0.002 * rng.standard_normal(len(T))
    bad = rng.uniform(size=len(T)) < rate
    bad[:3] = bad[-3:] = False
    y += np.where(bad, rng.choice([-1.0, 1.0], len(T)) * rng.uniform(0.05, 0.5, len(T)), 0.0)
    flags = spikes(T, y, noise_sigma(T, y))
    assert (flags & bad).sum() >= (found - 2.0 * rate) * bad.sum()
    assert (flags & ~bad).sum() <= 2


@pytest.mark.parametrize(("length", "is_spike"), [(1, True), (2, True), (3, True), (5, False), (40, False)])
def test_a_spike_comes_back_within_three_samples(length: int, is_spike: bool) -> None:
    y = MOTIONS["sine"] + 0.002 * np.random.default_rng(7).standard_normal(len(T))
    bad = np.zeros(len(T), dtype=bool)
    for k in range(100, 3900, 100):
        bad[k : k + length] = True
    flags = spikes(T, y + 0.2 * bad, 0.002)
    assert (flags & bad).sum() == (bad.sum() if is_spike else 0)
    assert not (flags & ~bad).any()


def test_short_and_empty_channels_have_neither() -> None:
    for y in (np.zeros(0), np.array([1.0]), np.full(20, np.nan), np.arange(5.0)):
        t: FloatArray = np.arange(float(len(y)))
        assert noise_sigma(t, y) == 0.0 and not spikes(t, y, 0.0).any() and len(fresh_samples(y)) == len(y)


def test_stamps_that_are_next_to_equal_do_not_overflow(rng: np.random.Generator) -> None:
    t, y = T[:200].copy(), 0.01 * rng.standard_normal(200)
    t[:3] = [0.0, 1e-180, 2e-180]
    assert noise_sigma(t, y) == pytest.approx(0.01, rel=0.3)


def test_repeats_of_a_sensor_that_misses_updates_at_random_are_not_fresh(rng: np.random.Generator) -> None:
    """As far as it moves: nobody can tell a repeat from a new reading of a joint that stands still."""
    y = np.sin(3.0 * T) + 0.001 * rng.standard_normal(len(T))
    missed = rng.uniform(size=len(T)) < 0.12
    missed[0] = False
    for k in np.flatnonzero(missed):
        y[k] = y[k - 1]
    found, moving = ~fresh_samples(y), np.abs(np.cos(3.0 * T)) > 0.6
    assert not found[~missed].any() and found[missed & moving].mean() > 0.9
    assert not spikes(T, y, noise_sigma(T, y)).any()
    y = np.round(y / 0.01) * 0.01
    assert not (~fresh_samples(y))[~missed & moving].any()


def test_a_motion_that_pauses_is_fresh(rng: np.random.Generator) -> None:
    """Quantised, it stands exactly still, and then goes on in the same direction."""
    y = np.cumsum(np.where((np.arange(len(T)) // 50) % 2 == 0, 0.01, 0.0))
    assert fresh_samples(y).all()
