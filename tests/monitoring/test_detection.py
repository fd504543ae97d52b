"""The sequential test: few false alarms on correlated, coloured blocks that it was not tuned on, and a clear change is
seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from residual_mpc.monitoring.detection import cusum
from residual_mpc.monitoring.detection.calibrate import calibrate
from residual_mpc.monitoring.detection.change_point import change_point
from residual_mpc.monitoring.detection.exceedance import far_above, limits
from residual_mpc.monitoring.settings import DetectionSettings

SETTINGS = DetectionSettings(hours=20.0, draws=150)
BLOCK, SERIES = 30, 4


def blocks(rng: np.random.Generator, n: int, persistence: float = 0.1) -> np.ndarray:
    """(n, S) means that are correlated from one to the next and share a part over the series."""
    fresh = 0.6 * rng.standard_normal((n, 1)) + 0.8 * rng.standard_normal((n, SERIES))
    out = np.empty_like(fresh)
    out[0] = fresh[0]
    for k in range(1, n):
        out[k] = persistence * out[k - 1] + np.sqrt(1.0 - persistence**2) * fresh[k]
    return 0.3 * out


def first_alarm(
    reference: np.ndarray, stream: np.ndarray, thresholds: cusum.Thresholds
) -> tuple[int, cusum.Alarm] | None:
    """Block and alarm."""
    state = cusum.init(len(thresholds.allowances), SERIES)
    centre, spread = reference.mean(axis=0), reference.std(axis=0, ddof=1)
    for k, mean in enumerate(stream):
        z = np.clip((mean - centre) / spread, -SETTINGS.clip, SETTINGS.clip)
        state = cusum.step(state, z, thresholds)
        if (alarm := cusum.alarm(state, thresholds)) is not None:
            return k, alarm
    return None


@pytest.mark.slow
@pytest.mark.parametrize("n", [12, 40])
def test_false_alarms_are_as_rare_as_promised_however_short_the_reference(n: int) -> None:
    """Of 60 references and streams of 20 h each, at most the promised share raises an alarm, up to chance."""
    rng = np.random.default_rng(5)
    length = int(SETTINGS.hours * 3600 / BLOCK)
    alarms = 0
    for _ in range(60):
        reference = blocks(rng, n)
        thresholds = calibrate(reference, BLOCK, 1.0, rng, SETTINGS)
        alarms += first_alarm(reference, blocks(rng, length), thresholds) is not None
    assert alarms <= 60 * SETTINGS.false_alarm + 2.0 * np.sqrt(60 * SETTINGS.false_alarm)


def test_textbook_thresholds_would_not_keep_the_promise() -> None:
    """With the reference's mean and spread taken as known, alarms are several times as frequent: the calibration is
    needed."""
    rng = np.random.default_rng(6)
    length = int(SETTINGS.hours * 3600 / BLOCK)
    known = calibrate(blocks(rng, 4000), BLOCK, 1.0, rng, SETTINGS)
    alarms = 0
    for _ in range(40):
        alarms += first_alarm(blocks(rng, 12), blocks(rng, length), known) is not None
    assert alarms > 40 * 2 * SETTINGS.false_alarm


@pytest.mark.parametrize("shift", [1.0, -1.0])
def test_a_change_of_one_series_is_seen_with_its_direction_and_its_beginning(shift: float) -> None:
    rng = np.random.default_rng(7)
    reference = blocks(rng, 40)
    thresholds = calibrate(reference, BLOCK, 1.0, rng, SETTINGS)
    stream = blocks(rng, 60)
    stream[30:, 2] += shift
    found = first_alarm(reference, stream, thresholds)
    assert found is not None
    at, alarm = found
    assert alarm.series == 2 and alarm.grows == (shift > 0)
    assert 30 <= at <= 36 and abs(alarm.since - 30) <= 2


def test_a_series_without_a_value_stays_as_it_is() -> None:
    thresholds = cusum.Thresholds(np.array([0.5]), np.array([5.0]))
    state = cusum.step(cusum.init(1, 2), np.array([3.0, 3.0]), thresholds)
    after = cusum.step(state, np.array([np.nan, -3.0]), thresholds)
    assert after.sums[0, 0, 0] == 2.5 and after.sums[0, 0, 1] == 0.0


@pytest.mark.parametrize("shift", [0.6, 1.5])
def test_a_change_begins_at_the_window_where_the_scores_rise(shift: float) -> None:
    """Half of the dates are within a few windows, fewer for a larger change."""
    rng = np.random.default_rng(9)
    off = []
    for _ in range(40):
        scores = rng.standard_normal(90)
        scores[55:] += shift
        scores[rng.random(90) < 0.05] = np.nan
        off.append(abs(change_point(scores) - 55))
    assert np.median(off) <= (2 if shift > 1.0 else 8)


def far(rest: np.ndarray) -> int | None:
    """The series whose errors are far above 200 windows of a reference with two series."""
    reference = np.random.default_rng(10).standard_normal((200, 2))
    return far_above(rest, limits(reference, 1.0, SETTINGS), SETTINGS)


def test_errors_far_above_all_of_the_reference_are_told_after_a_few_windows() -> None:
    steady = np.random.default_rng(11).standard_normal((40, 2))
    n = SETTINGS.large_windows
    assert far(steady) is None
    large = steady.copy()
    large[-n:, 1] += 2.0 * np.log(10.0)  # ten times the error
    assert far(large) == 1
    assert far(large[: 5 - n]) is None  # for too short a time
    twice = steady.copy()
    twice[-n:, 1] += 2.0 * np.log(1.3)  # left to the cumulative sums
    assert far(twice) is None


@pytest.mark.parametrize("correlation", [0.3, 0.5])
def test_steady_errors_are_seldom_far_above_and_large_ones_can_be(correlation: float) -> None:
    """Thirty robots of 20 h, whose neighbouring windows are correlated: no more alarms than promised, up to chance; and
    limits that an error 7.5 times as large exceeds."""
    found, n, alarms = list[float](), SETTINGS.large_windows, 0
    for seed in range(30):
        drawn = np.random.default_rng(seed).standard_normal((72_660, 1))
        rest = lfilter([np.sqrt(1.0 - correlation**2)], [1.0, -correlation], drawn, axis=0)[60:]
        limit = float(limits(rest[:600], 1.0, SETTINGS)[0])
        alarms += np.convolve(rest[600:, 0], np.ones(n) / n, "valid").max() > limit
        found.append(limit)
    assert alarms <= 30 * SETTINGS.large + 2.0 * np.sqrt(30 * SETTINGS.large)
    assert max(found) < 2.0 * np.log(7.5)


def test_steady_errors_that_are_correlated_over_minutes_are_not_far_above() -> None:
    """Ten robots of 20 h, windows correlated by 0.9 from one to the next: no error is large enough there."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        rest = lfilter([np.sqrt(1.0 - 0.9**2)], [1.0, -0.9], rng.standard_normal((72_300, 1)), axis=0)[60:]
        n, limit = SETTINGS.large_windows, limits(rest[:240], 1.0, SETTINGS)
        means = np.convolve(rest[240:, 0], np.ones(n) / n, "valid")
        assert means.max() < limit[0]


def test_the_second_test_takes_its_share_from_what_is_promised() -> None:
    with pytest.raises(ValueError, match="large must be less than false_alarm"):
        DetectionSettings(false_alarm=0.01)


def test_windows_that_are_driven_unlike_the_reference_do_not_count_as_far_above() -> None:
    large = np.full((40, 2), 20.0)
    large[::3] = np.nan
    assert far(large) is None
