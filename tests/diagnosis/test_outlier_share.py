"""The share of samples that jump, of which the smaller ones are not flagged."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.diagnosis.data.outlier_share import expected_jumps
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.logs.jumps import spikes

SIGMA, SAMPLES = 0.02, 6000
CHANNEL = "position.j1"


def jumping(rate: float, smallest: float, seed: int) -> tuple[Signal, np.ndarray, np.ndarray]:
    """Two minutes of a motion at 50 Hz with jumps of 1 to 5 times the smallest, which samples are flagged, and which
    were moved."""
    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / 50.0
    fast = rng.uniform(0.3, 1.0, 3) * np.sin(np.outer(t, rng.uniform(4.0, 20.0, 3)) + rng.uniform(0.0, 6.0, 3))
    y = fast.sum(axis=1) + SIGMA * rng.standard_normal(SAMPLES)
    moved = rng.random(SAMPLES) < rate
    y[moved] += rng.choice((-1.0, 1.0), moved.sum()) * smallest * rng.uniform(1.0, 5.0, moved.sum())
    return Signal(t, y), spikes(t, y, SIGMA), moved


def jumps_of(signal: Signal, flagged: np.ndarray) -> np.ndarray:
    key = (0, CHANNEL)
    return expected_jumps({key: signal}, {key: flagged}, SIGMA)[key]


def test_hidden_jumps_are_counted() -> None:
    """Jumps beyond six sigma, of which the motion hides most: more than half of them are counted all the same."""
    flagged, counted, true = np.mean(
        [
            (flagged.mean(), jumps_of(signal, flagged).mean(), moved.mean())
            for signal, flagged, moved in (jumping(0.04, 6.0 * SIGMA, seed) for seed in range(4))
        ],
        axis=0,
    )
    assert flagged < 0.6 * true
    assert flagged + 0.5 * (true - flagged) < counted < 1.1 * true


def test_jumps_that_no_motion_hides_stand_for_themselves() -> None:
    signal, flagged, moved = jumping(0.02, 2.0, 0)
    jumps = jumps_of(signal, flagged)
    assert np.array_equal(jumps > 0.0, flagged)
    assert jumps.mean() == pytest.approx(moved.mean(), rel=0.05)
    assert jumps[flagged].min() >= 1.0 and jumps[flagged].max() < 1.3


def test_without_a_flag_there_is_no_jump() -> None:
    signal, _, _ = jumping(0.0, 1.0, 1)
    assert not jumps_of(signal, np.zeros(SAMPLES, dtype=bool)).any()


def test_a_short_log_keeps_its_flags() -> None:
    """Too few samples to measure how many are missed."""
    signal = Signal(np.arange(20) / 50.0, np.zeros(20))
    flagged = np.arange(20) == 10
    assert np.array_equal(jumps_of(signal, flagged), flagged.astype(float))
