"""The intervals of the fitted numbers: as wide as the numbers scatter when the noise is drawn again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis.linear import GAIN, ROVER, SCALE, WIDTH, Linear, coloured, explained, fitted, space_of, white, windows
from oracles.rover_log import SIGMA, rover_run

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.results.causes import causes_of
from residual_mpc.diagnosis.results.intervals import spread_of
from residual_mpc.diagnosis.results.records import Cause, Estimate
from residual_mpc.diagnosis.results.settings import CauseSettings, ResultSettings
from residual_mpc.diagnosis.results.support import Support
from residual_mpc.diagnosis.results.variation_records import Variation
from residual_mpc.models.settings import Knob

TUNED = ResultSettings(causes=CauseSettings(law=0.0, order=0.0))  # what the data say by themselves

DRAWS = 40
TRUTH = {SCALE: 1.2, GAIN: 0.9}
LAG = Knob("actuator_lag", None, "time_constant")
DELAY = Knob("command_delay", None, "delay")
NOTHING: Mapping[Knob, tuple[float, ...]] = MappingProxyType({})
DATA = windows(2, 30.0)
SPACE = space_of(DATA)
COLUMNS = dict(zip(TRUTH, 3.0 * np.random.default_rng(5).standard_normal((2, DATA.count, 30)), strict=True))


def estimates(
    of: Any,
    unexplained: float = 0.0,
    lacking: Mapping[Knob, tuple[float, ...]] = NOTHING,
    settings: ResultSettings = TUNED,
) -> dict[str, Estimate]:
    """Each parameter of the explanation, by name; lacking: the values without an effect, which is then in doubt."""
    return {e.name: e for cause in causes_beside(of, unexplained, lacking, settings) for e in cause.parameters}


def causes_beside(
    of: Any, unexplained: float, lacking: Mapping[Knob, tuple[float, ...]], settings: ResultSettings
) -> tuple[Cause, ...]:
    """The causes, of which the first is in doubt where the values without it are given."""
    terms = of.final.terms
    supports, doubt = dict.fromkeys(terms, Support((), 1.0)), dict.fromkeys(terms, 1.0)
    doubt[terms[0]] = 0.5 if lacking else 1.0
    return causes_of(of, unexplained, dict.fromkeys(terms, 1.0), supports, doubt, lambda terms: lacking, settings)


def half_width(e: Estimate) -> float:
    return 0.5 * (e.ci95[1] - e.ci95[0])


def linear(noise: np.ndarray) -> Linear:
    return Linear(DATA, SPACE, COLUMNS, TRUTH, noise)


def test_under_white_noise_an_interval_is_that_of_least_squares() -> None:
    """1.96 standard deviations of the textbook's (J'J)^-1, here with noise of unit size."""
    j = np.stack([c.ravel() for c in COLUMNS.values()], axis=1)
    exact = 1.96 * np.sqrt(np.diag(np.linalg.inv(j.T @ j)))
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(DRAWS):
        problem = linear(white(DATA, rng))
        found = estimates(explained(problem, fitted(problem, {SCALE: 1.0, GAIN: 1.0})))
        drawn.append([half_width(found["scale"]), half_width(found["gain"])])
    np.testing.assert_allclose(np.mean(drawn, axis=0), exact, rtol=0.3)


@pytest.mark.parametrize("size", [0.0, 0.2])
def test_an_interval_covers_the_truth_and_is_no_wider_than_the_numbers_scatter(size: float) -> None:
    """Also where the noise of a stretch of time pushes one way, which least squares alone would take for certainty."""
    rng = np.random.default_rng(1)
    values, halves = [], []
    for _ in range(DRAWS):
        problem = linear(coloured(DATA, COLUMNS[SCALE], size, rng))
        found = estimates(explained(problem, fitted(problem, {SCALE: 1.0, GAIN: 1.0})))
        values.append([found["scale"].value, found["gain"].value])
        halves.append([half_width(found["scale"]), half_width(found["gain"])])
    off, half = np.abs(np.array(values) - list(TRUTH.values())), np.array(halves)
    spread = 1.96 * np.std(values, axis=0, ddof=1)
    assert (half.mean(axis=0) / spread > 0.6).all() and (half.mean(axis=0) / spread < 1.6).all()
    assert ((off < half).mean(axis=0) > 0.85).all()


def test_an_interval_of_a_threshold_is_where_the_cost_rises_by_that_of_one_sigma() -> None:
    """Its derivative says nothing; the profile is looked at in steps of two, whence the factor."""
    column = np.full((DATA.count, 30), 40.0)
    rng = np.random.default_rng(2)
    problem = Linear(DATA, SPACE, {WIDTH: column}, {WIDTH: 1.0}, white(DATA, rng))
    fit = fitted(problem, {WIDTH: 1.0})
    exact = 1.96 / np.sqrt((column**2).sum())
    flat = replace(fit, jacobian=np.full_like(fit.jacobian, 1e9))  # as if the derivative knew it for certain
    half = half_width(estimates(explained(problem, flat))["width"])
    assert exact < half < 2.6 * exact


def test_an_interval_of_the_rover_is_as_wide_as_its_numbers_scatter() -> None:
    """The whole way from noisy poses, through start states that are measured as well, to the interval."""
    faults = {"track_width": {"scale": 1.2}, "actuator_lag": {"time_constant": 0.1}}
    clean = rover_run("r", faults, 10.0, seed=1, noise=0.0)
    values, halves = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noisy = {c: y + SIGMA[c] * rng.standard_normal(len(y)) if c in SIGMA else y for c, y in clean.columns.items()}
        data = build_dataset([replace(clean, columns=noisy)], [ROVER], SIGMA)
        problem = build_problem(data, space_of(data), data.sigma)
        found = estimates(explained(problem, fitted(problem, {SCALE: 1.15, LAG: 0.12})))
        values.append([found["scale"].value, found["time_constant"].value])
        halves.append([half_width(found["scale"]), half_width(found["time_constant"])])
    ratio = np.mean(halves, axis=0) / (1.96 * np.std(values, axis=0, ddof=1))
    assert (ratio > 0.5).all() and (ratio < 2.0).all()


def known(**others: object) -> Any:
    """A fit that has an interval of its own, with what widens it."""
    problem = linear(white(DATA, np.random.default_rng(3)))
    return explained(problem, fitted(problem, {SCALE: 1.0, GAIN: 1.0}), **others)


def test_what_is_left_unexplained_may_pull_a_number_by_its_share_of_the_effect() -> None:
    plain, pulled = estimates(known())["scale"], estimates(known(), unexplained=0.25)["scale"]
    pull = TUNED.causes.form * np.sqrt(0.25) * abs(plain.value - 1.0)
    assert half_width(pulled) == pytest.approx(np.hypot(half_width(plain), pull), rel=1e-6)


def test_no_size_is_known_better_than_its_law() -> None:
    """However little the noise, half of an interval is at least 3 % of the effect."""
    plain = estimates(known())["scale"]
    found = estimates(known(), settings=ResultSettings())["scale"]
    law = 0.03 * abs(plain.value - 1.0)
    assert half_width(found) == pytest.approx(np.hypot(half_width(plain), law), rel=1e-6)


def test_a_dead_time_and_a_lag_that_are_both_named_may_take_from_each_other() -> None:
    """Each by 12 % of the lag; either of them alone by nothing."""
    settings = ResultSettings(causes=CauseSettings(law=0.0))
    columns = dict(zip((DELAY, LAG), COLUMNS.values(), strict=True))
    truth = {DELAY: 0.1, LAG: 0.2}

    def halves(of: tuple[Knob, ...], settings: ResultSettings) -> np.ndarray:
        some = {k: columns[k] for k in of}
        problem = Linear(DATA, SPACE, some, {k: truth[k] for k in of}, white(DATA, np.random.default_rng(6)))
        found = estimates(explained(problem, fitted(problem, {k: truth[k] for k in of})), settings=settings)
        return np.array([half_width(found[k.parameter]) for k in of])

    both = (DELAY, LAG)
    np.testing.assert_allclose(halves(both, settings), np.hypot(halves(both, TUNED), 0.12 * 0.2), rtol=0.05)
    for alone in both:
        assert halves((alone,), settings) == halves((alone,), TUNED)


def test_an_interval_holds_other_ends_of_the_fit_and_fits_without_a_doubtful_effect() -> None:
    plain = estimates(known())["scale"]
    ended = estimates(known(ends={SCALE: (plain.value, 1.5)}))["scale"]
    assert ended.ci95 == pytest.approx((plain.ci95[0], 1.5)) and "differ and are equally good" in ended.note
    lacked = estimates(known(), lacking={SCALE: (0.8,)})["scale"]
    assert lacked.ci95 == pytest.approx((0.8 - half_width(plain), plain.ci95[1])) and not lacked.note


def test_an_interval_holds_the_mean_of_the_sizes_in_single_runs() -> None:
    """One run that moves much may fix a number that the others contradict; what varies with the motion has no mean."""
    of = known()
    plain, term = spread_of(of, {}, TUNED), SCALE.term
    by_run, by_motion = Variation(by_run={"a": 1.0, "b": 1.6}), Variation(by_motion={"small": 1.0, "large": 1.6})
    for variation, mean in ((by_run, (1.3,)), (by_motion, ())):
        found = spread_of(of, {term: variation}, TUNED)
        assert found.others[SCALE] == (*plain.others[SCALE], *mean)
        assert found.others[GAIN] == plain.others[GAIN]
        np.testing.assert_array_equal(found.sigma, plain.sigma)  # two runs tell no scatter between them


def test_an_interval_holds_the_value_beside_one_more_small_effect() -> None:
    """With an interval of the same width; the other number does not move."""
    plain, found = estimates(known()), estimates(known(omitted=({SCALE: 0.3, GAIN: 0.0},)))
    assert found["scale"].ci95 == pytest.approx((plain["scale"].ci95[0], plain["scale"].ci95[1] + 0.3))
    assert found["gain"].ci95 == pytest.approx(plain["gain"].ci95)


def test_an_effect_that_may_do_nothing_beside_a_doubtful_one_is_less_likely() -> None:
    """A gain of 0.9, and of 1 without the radius, which may not be there; of 0.9 without it, it stays as sure."""
    of = known()
    likely = {value: causes_beside(of, 0.0, {GAIN: (value,)}, TUNED) for value in (0.9, 1.0)}
    gains = {value: next(c for c in some if c.term.effect == GAIN.effect) for value, some in likely.items()}
    assert gains[0.9].probability == 1.0 and gains[1.0].probability == TUNED.causes.resting


def test_an_interval_holds_the_values_beside_another_member_of_a_confounded_group() -> None:
    """With an interval as wide as that beside the named member; a rival that the runs rule out does not count."""
    of = known()
    plain = estimates(of)["scale"]
    beside = [SimpleNamespace(alike=alike, fit=SimpleNamespace(values={SCALE: value}))
              for alike, value in ((True, 1.6), (False, 2.0))]  # fmt: skip
    found = estimates(known(rivalry=SimpleNamespace(shares={}, rivals=beside)))["scale"]
    assert found.ci95 == pytest.approx((plain.ci95[0], 1.6 + half_width(plain))) and found.value == plain.value


def test_an_interval_holds_that_of_the_fit_with_small_differences_elsewhere() -> None:
    """Four times the noise, so four times the interval, about that fit's own value."""
    of = known()
    louder = linear(4.0 * of.problem.noise)
    fit = fitted(louder, of.final.values)
    tolerated = SimpleNamespace(problem=louder, fit=fit, part=of.problem, plain=of.final)
    alone = estimates(explained(louder, fit))["scale"]
    both = estimates(known(tolerated=tolerated))["scale"]
    assert both.ci95 == pytest.approx(alone.ci95) and both.value == pytest.approx(of.final.values[SCALE])


def test_small_differences_on_some_windows_shift_and_widen_an_interval_by_what_they_change_there() -> None:
    """With 2 and 4 times the noise, so about values that are 2 and 4 times as far from the truth: shifted by twice the
    error, with the variances of 16 - 4 + 1."""
    of = known()
    part, louder = linear(2.0 * of.problem.noise), linear(4.0 * of.problem.noise)
    plain, wide = fitted(part, of.final.values), fitted(louder, of.final.values)
    own = estimates(of)["scale"]
    found = estimates(known(tolerated=SimpleNamespace(problem=louder, fit=wide, part=part, plain=plain)))["scale"]
    centre = of.final.values[SCALE] + wide.values[SCALE] - plain.values[SCALE]
    assert centre - TRUTH[SCALE] == pytest.approx(3.0 * (of.final.values[SCALE] - TRUTH[SCALE]), rel=1e-3)
    half = 13.0**0.5 * half_width(own)
    wanted = (min(own.ci95[0], centre - half), max(own.ci95[1], centre + half))
    assert found.ci95 == pytest.approx(wanted, abs=0.01 * half)


def test_an_interval_ends_at_the_bound_of_what_is_possible() -> None:
    low, _ = SPACE.bounds(SCALE)
    found = estimates(known(), lacking={SCALE: (low - 1.0,)})["scale"]
    assert found.ci95[0] == low


@pytest.mark.parametrize(("delay", "low"), [(0.01, 0.0), (-0.01, -0.05)])
def test_the_interval_of_a_delay_is_negative_only_where_the_delay_is(delay: float, low: float) -> None:
    """A log may hold fewer commands than were sent, and only then do they act before their stamps."""
    columns = {DELAY: 1e4 * COLUMNS[GAIN]}
    problem = Linear(DATA, SPACE, columns, {DELAY: delay}, white(DATA, np.random.default_rng(6)))
    of = explained(problem, fitted(problem, {DELAY: delay}), ends={DELAY: (delay, low - 1.0)})
    found = estimates(of)["delay"]
    assert np.sign(found.value) == np.sign(delay) and found.ci95[0] == pytest.approx(low)


def test_a_number_on_its_bound_has_the_interval_of_its_curvature() -> None:
    _, high = SPACE.bounds(GAIN)
    truth = {SCALE: 1.2, GAIN: high + 0.1}
    problem = Linear(DATA, SPACE, COLUMNS, truth, white(DATA, np.random.default_rng(4)))
    found = estimates(explained(problem, fitted(problem, {SCALE: 1.0, GAIN: high})))["gain"]
    alone = 1.96 / np.sqrt((COLUMNS[GAIN] ** 2).sum())
    assert "at the bound" in found.note and found.ci95[1] == found.value == high
    assert alone < found.value - found.ci95[0] < 2.0 * alone
