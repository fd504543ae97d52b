"""A sensor that jumps more often in one set than in the other."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from residual_mpc.comparison.outliers import changed_outliers
from residual_mpc.comparison.settings import ContrastSettings

SETTINGS = ContrastSettings()
SAMPLES = 400  # of a run of 20 s


def sets(rates: tuple[float, float], seed: int, runs: int = 6, channels: tuple[str, ...] = ("pose.x",)) -> Any:
    """`runs` runs before and as many after, the samples of which are outliers at these rates."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 20.0, SAMPLES)
    later = np.arange(2 * runs) >= runs
    flagged = {(i, c): rng.random(SAMPLES) < rates[int(later[i])] for i in range(2 * runs) for c in channels}
    enough = sum(int(f.sum()) for f in flagged.values()) >= 8
    noise = 1e-3 * rng.standard_normal((len(flagged), SAMPLES))
    signals = {
        key: SimpleNamespace(t=t, y=np.sin(0.5 * t) + e + 2.0 * mask)
        for e, (key, mask) in zip(noise, flagged.items(), strict=True)
    }
    return SimpleNamespace(
        later=later,
        raw=SimpleNamespace(signals=signals, channels=channels, sigma=np.full(len(channels), 1e-3)),
        outliers=SimpleNamespace(flagged=flagged, enough=enough),
    )


@pytest.mark.parametrize("rates", [(0.0, 0.03), (0.01, 0.06), (0.06, 0.01)])
def test_the_difference_of_the_rates_is_named_and_inside_its_interval(rates: tuple[float, float]) -> None:
    found = changed_outliers(sets(rates, 0, channels=("pose.x", "pose.y")), 0.97, SETTINGS)
    assert found is not None and found.term.effect == "sensor_outliers" and found.probability > 0.95
    (rate,) = found.parameters
    low, high = rate.ci95
    assert low < rates[1] - rates[0] < high and high - low < 0.03
    assert rate.change == pytest.approx(rate.after - rate.before)


def test_equal_rates_are_rarely_told_apart() -> None:
    named = [changed_outliers(sets((0.03, 0.03), seed), 0.97, SETTINGS) is not None for seed in range(150)]
    assert np.mean(named) <= 0.05  # the level is 2 %


def test_one_bad_stretch_is_no_change() -> None:
    one = sets((0.0, 0.0), 0)
    one.outliers.flagged[11, "pose.x"][100:130] = True
    one.outliers.enough = True
    assert changed_outliers(one, 0.97, SETTINGS) is None


def test_too_few_outliers_and_too_few_stretches_name_nothing() -> None:
    assert changed_outliers(sets((0.0, 0.0005), 1), 0.97, SETTINGS) is None
    few = sets((0.0, 0.05), 1, runs=1)
    for signal in few.raw.signals.values():
        signal.t = np.linspace(0.0, 4.0, SAMPLES)  # one stretch a set
    assert changed_outliers(few, 0.97, SETTINGS) is None
