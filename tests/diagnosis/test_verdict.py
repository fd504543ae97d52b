"""Verdicts: the contract's table, per horizon and channel; and how sure a named effect may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.diagnosis.data.gap import Gap
from residual_mpc.diagnosis.data.where import Where
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, _weighted_median, beyond, floor_from, with_luck
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.remainder.records import Curve, Dependence, Rest
from residual_mpc.diagnosis.results.causes import most_sure
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.support import Support, doubts
from residual_mpc.diagnosis.results.verdict import (
    HorizonGaps,
    beats_forecast,
    clearest,
    hardly_explained,
    left_share,
    verdict_of,
)
from residual_mpc.models.settings import Term


def floor(total: float, windows: int = 100) -> NoiseFloor:
    each = np.array([total, total])
    return NoiseFloor(total, each, 1.2 * total, 1.2 * each, windows)


def at(
    before: float, after: float, noise: float, horizon: float = 1.0, channels: tuple[float, ...] = ()
) -> HorizonGaps:
    """The gaps over one horizon; channels: those after, where they differ from the total."""
    left = np.array(channels or (after, after))
    start = Gap(before, np.array([before, before]))
    return HorizonGaps(horizon, 100, True, start, start, Gap(after, left), Gap(after, left), floor(noise), {})


@pytest.mark.parametrize(
    ("looks", "wanted"),
    [
        ([at(0.5, 0.015, 0.01)], "effects"),
        ([at(0.5, 0.019, 0.01), at(0.5, 0.04, 0.01, 5.0)], "effects"),  # at most 0.05 is small enough
        ([at(0.5, 0.015, 0.01), at(0.5, 0.08, 0.01, 5.0)], "partial"),  # one horizon shows more
        ([at(0.5, 0.08, 0.05, channels=(0.03, 0.11))], "partial"),  # one channel shows more
        ([at(0.5, 0.3, 0.01)], "partial"),
        ([at(0.5, 0.09, 0.05)], "effects"),  # within twice the noise
    ],
)
def test_an_explanation_is_whole_where_every_horizon_and_channel_says_so(looks: list[HorizonGaps], wanted: str) -> None:
    assert verdict_of(looks) == wanted


def test_the_share_left_is_that_of_the_headline() -> None:
    assert left_share(at(0.5, 0.3, 0.1)) == pytest.approx((0.09 - 0.01) / (0.25 - 0.01))
    assert left_share(at(0.5, 0.05, 0.1)) == 0.0


@pytest.mark.parametrize(
    ("before", "after", "hardly"),
    [(0.04, 0.035, True), (0.04, 0.025, True), (0.04, 0.021, False), (0.04, 0.015, False), (0.02, 0.018, False)],
)
def test_a_small_gap_that_hardly_gets_smaller_is_not_explained(before: float, after: float, hardly: bool) -> None:
    """Of a floor of 0.01; the last is within twice the noise."""
    assert hardly_explained(at(before, after, 0.01)) is hardly


def test_a_gap_is_clearest_where_noise_hardly_ever_makes_it() -> None:
    """Three times the floor of a single window may be chance; twice that of many windows is not."""
    many, one = at(0.02, 0.01, 0.01), at(0.03, 0.03, 0.01, 20.0)
    one = replace(one, windows=1, floor=replace(one.floor, luck=0.04, windows=1))
    assert clearest([many, one]) is many
    assert clearest([many, at(0.03, 0.03, 0.01, 20.0)]).horizon == 20.0


def test_one_channel_beyond_the_noise_is_enough() -> None:
    quiet = Gap(0.0105, np.array([0.0105, 0.0105]))
    loud = Gap(0.0115, np.array([0.009, 0.016]))
    assert not beyond(quiet, floor(0.01), settings=PredictSettings())
    assert beyond(loud, floor(0.01), settings=PredictSettings())
    assert not beyond(loud, floor(0.01, windows=3), settings=PredictSettings())  # three windows say little


@pytest.mark.parametrize("freedom", [3, 40])
def test_chance_exceeds_its_limit_as_rarely_as_stated(freedom: int) -> None:
    rng = np.random.default_rng(0)
    squares = rng.chisquare(freedom, (4000, 1)) / freedom
    limits = np.array(
        [with_luck(squares[i : i + 24], freedom, settings=PredictSettings())[0] for i in range(0, 960, 24)]
    )
    exceeded = np.mean(rng.chisquare(freedom, 200_000)[:, None] / freedom > limits[None, :] ** 2)
    assert exceeded < 0.005


def test_a_floor_is_the_root_mean_square_of_its_draws() -> None:
    drawn = [Gap(x, np.array([x, 2.0 * x])) for x in (0.01, 0.02, 0.03)]
    found = floor_from(drawn, 50, settings=PredictSettings())
    assert found.total == pytest.approx(np.sqrt(np.mean(np.square([0.01, 0.02, 0.03]))))
    assert found.channels[1] == pytest.approx(2.0 * found.total)
    assert found.luck > found.total


def test_how_sure_an_effect_may_be_falls_with_what_is_left() -> None:
    assert most_sure("effects", 0.0, 1.0, 1.0, settings=ResultSettings()) == ResultSettings().causes.most_sure
    assert most_sure("effects", 0.0, 4.0, 1.0, settings=ResultSettings()) < 0.9
    assert most_sure("partial", 0.0, 1.5, 1.0, settings=ResultSettings()) < 0.9
    steps = [
        most_sure("partial", share, times, 1.0, settings=ResultSettings())
        for share, times in ((0.0, 2.0), (0.1, 5.0), (0.3, 20.0), (0.9, 90.0))
    ]
    assert steps == sorted(steps, reverse=True)
    assert most_sure("unknown", 1.0, 50.0, 1.0, settings=ResultSettings()) == 0.0


def test_an_effect_that_stands_far_above_what_is_left_is_no_shadow_of_it() -> None:
    """Ten times what is left, squared, are not enough; from a hundred times on nothing is lost for it."""
    tuned = ResultSettings()
    ratios = (0.0, 10.0, 30.0, 100.0, 1e4)
    few, ten, some, hundred, far = (
        most_sure("partial", 0.2, 12.0, 1.0, settings=tuned, standing=ratio) for ratio in ratios
    )
    assert few == ten < some < hundred == far == pytest.approx(tuned.causes.most_sure * tuned.causes.most_partial)
    assert few < 0.5


def rest(kind: str, share: float) -> Rest:
    curve = Curve("forward", (), (), (), "", "")
    return Rest((), Where((), (), ()), 1.0, (Dependence(kind, kind, None, "added", share, 0.0, (), curve),), None)


@pytest.mark.parametrize("imitator", ["voltage_sag", "clock_skew"])
def test_a_remainder_that_depends_on_time_lowers_what_imitates_it(imitator: str) -> None:
    sag, lag = Term(imitator, None), Term("actuator_lag", None)
    supports = {t: Support(("fits", "predicts"), 9.0) for t in (sag, lag)}
    assert doubts(supports, rest("time", 0.5), settings=ResultSettings()) == {sag: 0.5, lag: 1.0}
    assert doubts(supports, rest("time", 0.05), settings=ResultSettings()) == {sag: 1.0, lag: 1.0}
    assert doubts(supports, None, settings=ResultSettings()) == {sag: 1.0, lag: 1.0}


def test_an_effect_that_does_not_predict_or_is_faint_is_less_sure() -> None:
    lag = Term("actuator_lag", None)
    assert doubts({lag: Support(("fits",), -0.1)}, None, settings=ResultSettings())[lag] == 0.25
    assert doubts({lag: Support(("fits", "predicts"), 0.5)}, None, settings=ResultSettings())[lag] == 0.75


@pytest.mark.parametrize(
    ("after", "forecast", "share"),
    [(0.35, 0.36, 0.0986), (0.35, 3.5, 0.9947), (0.4, 0.36, 0.0), (0.2, 0.15, 1.0), (0.35, 0.2, 0.0)],
)
def test_a_model_that_hardly_beats_a_forecast_of_constant_velocity(after: float, forecast: float, share: float) -> None:
    """The third is worse than the forecast; the fourth is as good as the sensors can tell."""
    assert beats_forecast(at(3.5, after, 0.12), forecast) == pytest.approx(share, abs=1e-3)


def test_it_leaves_doubt_on_every_cause() -> None:
    settings = ResultSettings()
    whole, half, none = (most_sure("partial", 0.0, 2.8, share, settings=settings) for share in (0.6, 0.3, 0.05))
    assert whole > 0.75 and half == pytest.approx(0.6 * whole)
    assert none == pytest.approx(settings.causes.least_sure * whole) and none < 0.5


def test_the_median_window_tells_what_a_few_windows_hide() -> None:
    """A few windows in which errors of the start grow make both the gap and the floor large."""
    look = at(1.0, 0.03, 0.03)
    assert look.times_floor == pytest.approx(1.0)
    sensitive = replace(look.floor, typical=0.003)
    usual = replace(look, quantiles={"after": {"p50": 0.012}}, floor=sensitive)
    assert usual.times_floor == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("verdict", "times", "expected"),
    [("effects", 1.6, 1.0), ("effects", 1.8, 0.935), ("effects", 2.0, 0.87),
     ("effects", 2.5, 0.87 - 0.15 * np.log(1.25)), ("effects", 4.0, 0.87 - 0.15 * np.log(2.0)),
     ("partial", 1.5, 0.87), ("partial", 4.0, 0.87 - 0.15 * np.log(2.0))],
)  # fmt: skip
def test_a_gap_that_is_small_but_above_the_noise_is_no_evidence(verdict: str, times: float, expected: float) -> None:
    settings = ResultSettings()
    found = most_sure(verdict, 0.0, times, 1.0, settings=settings)
    assert found == pytest.approx(settings.causes.most_sure * expected)


def test_the_median_window_is_that_of_all_windows_that_others_stand_for() -> None:
    x, weights = np.array([1.0, 2.0, 3.0, np.nan]), np.array([1.0, 1.0, 5.0, 9.0])
    assert _weighted_median(x, weights) == 3.0 and _weighted_median(x, np.array([1.0, 1.0, 1.0, 0.0])) == 2.0
    assert np.isnan(_weighted_median(x, np.zeros(4)))
