"""An outlier of a position spoils the velocity that a driver makes of it: by a difference, and for as long as its
filter remembers."""

import numpy as np
import pytest
from scipy.signal import lfilter

from residual_mpc.diagnosis.data.outliers import jumps_at
from residual_mpc.diagnosis.data.settings import OutlierSettings

RATE, SIGMA, SETTINGS = 250.0, 1e-4, OutlierSettings()
OUTLIERS = np.array([200, 431, 700, 903])


def velocity(remembered: float, size: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """(n,) rad/s: differences of a noisy position with outliers of `size` rad, under a first-order filter that keeps
    this share from one sample to the next; and what it is without the outliers."""
    rng = np.random.default_rng(0)
    t = np.arange(1200) / RATE
    clean = 0.4 * np.sin(3.0 * t) + SIGMA * rng.standard_normal(len(t))
    jumping = clean.copy()
    jumping[OUTLIERS] += size
    both = [lfilter([1.0 - remembered], [1.0, -remembered], np.diff(y, prepend=y[0]) * RATE) for y in (jumping, clean)]
    return both[0], both[1]


@pytest.mark.parametrize("remembered", [0.0, 0.5, 0.7])
def test_what_an_outlier_does_to_a_velocity_is_flagged(remembered: float) -> None:
    v, clean = velocity(remembered)
    sigma = float(np.std(np.diff(clean))) / np.sqrt(2.0)
    mask = jumps_at(v, OUTLIERS, sigma, SETTINGS)
    assert np.abs(v - clean)[~mask].max() < 0.1 * np.abs(v - clean).max()
    assert mask[np.abs(v - clean) < sigma].sum() <= 2
    assert mask.sum() <= 12 * len(OUTLIERS)


def test_nothing_is_flagged_beside_a_sound_velocity() -> None:
    _, clean = velocity(0.5)
    assert not jumps_at(clean, OUTLIERS, float(np.std(np.diff(clean))) / np.sqrt(2.0), SETTINGS).any()


def test_a_step_of_the_velocity_elsewhere_is_no_jump() -> None:
    v = np.where(np.arange(400) < 200, 0.0, 1.0) + 1e-3 * np.random.default_rng(1).standard_normal(400)
    assert not jumps_at(v, np.array([100, 300]), 1e-3, SETTINGS).any()
