"""The causes of a diagnosis: how sure each one is, what supports it, and its numbers in their units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis.linear import (
    GAIN,
    HEADING,
    RATE,
    ROVER,
    SCALE,
    WIDTH,
    Linear,
    explained,
    fitted,
    space_of,
    white,
    windows,
)
from oracles.rover_log import SIGMA, rover_run

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.data.outliers import Outliers
from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.results import causes
from residual_mpc.diagnosis.results.causes import ValuesWithout, causes_of
from residual_mpc.diagnosis.results.records import Cause
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.support import Support, support_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

TUNED = ResultSettings()

LAG = Knob("actuator_lag", None, "time_constant")
LIMIT = Knob("saturation", "left", "limit")
DATA = windows(2, 20.0)
SPACE = space_of(DATA)
SURE = Support(("fits", "predicts"), 5.0)


def linear(truth: Values, seed: int = 0) -> Linear:
    rng = np.random.default_rng(seed)
    return Linear(DATA, SPACE, {k: 3.0 * white(DATA, rng) for k in truth}, truth, white(DATA, rng))


def found(
    truth: Values,
    sure: float = 1.0,
    doubt: dict[Term, float] | None = None,
    beside: float = np.inf,
    values_without: ValuesWithout = lambda terms: {},
    **others: Any,
) -> dict[Term, Cause]:
    """The causes of a fit that starts at the truth. beside: of each effect, what it predicts beside another."""
    problem = linear(truth)
    fit = fitted(problem, {k: float(np.clip(v, *SPACE.bounds(k))) for k, v in truth.items()})
    of = explained(problem, fit, **others)
    some = dict.fromkeys(fit.terms, 1.0) | (doubt or {})
    supports = dict.fromkeys(fit.terms, replace(SURE, beside=beside))
    each = dict.fromkeys(fit.terms, sure)
    return {c.term: c for c in causes_of(of, 0.0, each, supports, some, values_without, TUNED)}


def test_a_cause_is_as_sure_as_all_allows_that_speaks_for_it() -> None:
    """What any cause gets, times its share among its rivals, times its own doubt."""
    rivalry = SimpleNamespace(shares={SCALE.term: 0.8}, rivals=())
    causes = found({SCALE: 1.2, GAIN: 0.9}, sure=0.9, doubt={SCALE.term: 0.5}, rivalry=rivalry)
    assert causes[SCALE.term].probability == pytest.approx(0.9 * 0.8 * 0.5)
    assert causes[GAIN.term].probability == pytest.approx(0.9)
    assert causes[GAIN.term].evidence == SURE.evidence


def test_a_cause_whose_number_rests_on_its_bound_is_less_sure() -> None:
    beyond = SPACE.bounds(GAIN)[1] + 1.0
    causes = found({SCALE: 1.2, GAIN: beyond})
    assert causes[GAIN.term].probability == pytest.approx(TUNED.causes.resting * causes[SCALE.term].probability)
    (gain,) = causes[GAIN.term].parameters
    assert gain.value == SPACE.bounds(GAIN)[1] and gain.note


def test_so_is_one_whose_number_rests_beside_it() -> None:
    """Where its interval ends at the bound; farther inside it does not count."""
    bound = SPACE.bounds(GAIN)[1]
    for value, share in ((bound - 0.01 * (bound - 1.0), TUNED.causes.resting), (0.9 * bound, 1.0)):
        causes = found({SCALE: 1.2, GAIN: value})
        assert causes[GAIN.term].probability == pytest.approx(share * causes[SCALE.term].probability)
        assert bool(causes[GAIN.term].parameters[0].note) == (share < 1.0)


@pytest.mark.parametrize(("beside", "low"), [(0.05, 0.7), (0.5, None)])
def test_a_small_effect_on_its_bound_widens_the_intervals_of_the_others(beside: float, low: float | None) -> None:
    """They hold the values without it; of one that predicts much, the name is in doubt alone."""
    asked: list[Term] = []

    def lacking(terms: Sequence[Term]) -> dict[Knob, tuple[float, ...]]:
        asked.extend(terms)
        return {SCALE: (0.7,)}

    causes = found({SCALE: 1.2, GAIN: SPACE.bounds(GAIN)[1] + 1.0}, beside=beside, values_without=lacking)
    assert asked == ([] if low is None else [GAIN.term])
    interval = causes[SCALE.term].parameters[0].ci95
    assert interval[0] < low if low is not None else interval[0] > 1.0


def test_a_number_at_the_limit_of_what_can_be_is_as_sure(monkeypatch: pytest.MonkeyPatch) -> None:
    """All of a joint's damping may sit behind its gear."""
    gain = BY_NAME["actuator_gain"].parameter("gain")
    assert BY_NAME["joint_compliance"].parameter("damping_behind").physical_bounds and not gain.physical_bounds
    effect = replace(BY_NAME["actuator_gain"], parameters=(replace(gain, physical_bounds=True),))
    monkeypatch.setattr("residual_mpc.diagnosis.results.intervals.BY_NAME", {**BY_NAME, "actuator_gain": effect})
    causes = found({SCALE: 1.2, GAIN: SPACE.bounds(GAIN)[1] + 1.0})
    assert causes[GAIN.term].probability == pytest.approx(causes[SCALE.term].probability)
    assert not causes[GAIN.term].parameters[0].note


def test_a_cause_that_may_do_nothing_is_less_sure() -> None:
    """Where the interval of its size contains none; how it acts (the heading of a slope) has no such value."""
    causes = found({SCALE: 1.2, GAIN: 1.0, RATE: 0.1, HEADING: 0.0})
    (gain,) = causes[GAIN.term].parameters
    assert gain.ci95[0] <= 1.0 <= gain.ci95[1]
    assert causes[GAIN.term].probability == pytest.approx(TUNED.causes.resting * causes[SCALE.term].probability)
    assert causes[RATE.term].probability == causes[SCALE.term].probability


def test_a_limit_that_nothing_may_exceed_is_less_sure() -> None:
    largest = SPACE.references["output", "left"]
    for limit, share in ((0.5 * largest, 1.0), (largest, TUNED.causes.resting), (1.15 * largest, TUNED.causes.resting)):
        causes = found({SCALE: 1.2, LIMIT: limit})
        assert causes[LIMIT.term].probability == pytest.approx(share * causes[SCALE.term].probability)


def test_numbers_come_with_their_units() -> None:
    causes = found({WIDTH: 1.0, SCALE: 1.2, RATE: 0.1, HEADING: 0.5})
    units = {p.name: p.unit for c in causes.values() for p in c.parameters}
    assert units == {"width": "rad/s", "scale": "1", "rate": "m/s", "heading": "rad"}


@pytest.mark.parametrize("turns", [-2, 1])
def test_a_heading_is_given_within_half_a_turn(turns: int) -> None:
    """With an interval that its bounds do not cut."""
    causes = found({RATE: 0.1, HEADING: 3.1 + 2 * np.pi * turns})
    heading = {p.name: p for p in causes[Term("slope", None)].parameters}["heading"]
    assert -np.pi <= heading.value <= np.pi
    assert heading.ci95[0] < heading.value < heading.ci95[1]
    assert 0.5 * sum(heading.ci95) == pytest.approx(heading.value)


def test_jumping_samples_are_a_cause_whose_rate_scatters_as_counts_do() -> None:
    """Half-width against 1.96 standard deviations of a binomial rate. No motion hides these jumps."""
    count, n = 30, 3000
    mask = np.zeros(n, dtype=bool)
    mask[50 :: n // count] = True
    t = 0.05 * np.arange(n)
    signal = Signal(t, np.sin(0.2 * t) + 1e-3 * np.random.default_rng(0).standard_normal(n) + 2.0 * mask)
    raw = SimpleNamespace(signals={(0, "pose.x"): signal}, sigma=np.array([1e-3]), channels=("pose.x",))
    outliers = Outliers({(0, "pose.x"): mask}, {"pose.x": count / n, "pose.y": 0.0}, count / n, count, True, False)
    cause = found({SCALE: 1.2}, with_outliers=True, outliers=outliers, raw=raw)[Term("sensor_outliers", None)]
    (rate,) = cause.parameters
    assert cause.probability == TUNED.causes.most_sure and rate.value == pytest.approx(0.01, rel=0.02)
    exact = 1.96 * np.sqrt(0.01 * 0.99 / n)
    assert 0.5 * (rate.ci95[1] - rate.ci95[0]) == pytest.approx(exact, rel=0.1)
    assert rate.ci95[0] < 0.01 < rate.ci95[1]


def supports_on(run: int) -> dict[Term, Support]:
    """Of a track width that all runs share, and of a lag that is in one of four alone, judged on one of them."""
    faults = [{"track_width": {"scale": 1.2}} for _ in range(4)]
    faults[2] |= {"actuator_lag": {"time_constant": 0.3}}
    runs = [rover_run(f"r{k}", f, 6.0, seed=k) for k, f in enumerate(faults)]
    data = build_dataset(runs, [ROVER] * 4, SIGMA)
    problem = build_problem(data, space_of(data), data.sigma)
    fit = fitted(problem, {SCALE: 1.15, LAG: 0.1})
    of = explained(problem, fit, scales=measure_scales(data), after_data=data, raw=data, test=data.run == run)
    look: Any = SimpleNamespace(horizon=1.0, floor=SimpleNamespace(total=0.01))
    return support_of(of, (), [look], TUNED)


def test_an_effect_that_one_run_alone_shows_does_not_survive_without_it() -> None:
    found = supports_on(2)
    assert "survives" in found[SCALE.term].evidence and "survives" not in found[LAG.term].evidence


def test_an_effect_predicts_where_the_judged_windows_have_it_and_not_elsewhere() -> None:
    there, elsewhere = supports_on(2), supports_on(0)
    assert "predicts" in there[LAG.term].evidence and there[LAG.term].strength > 0.0
    assert "predicts" not in elsewhere[LAG.term].evidence and elsewhere[LAG.term].strength < 0.0
    assert "predicts" in there[SCALE.term].evidence and "predicts" in elsewhere[SCALE.term].evidence


def test_a_law_is_as_uncertain_as_the_runs_disagree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two numbers one moves three times as far between runs as the scatter within them explains."""
    term = Term("fitted_law_torque_position", "j")
    knobs = tuple(Knob(*term[:2], name) for name in ("start", "rise2"))
    final = SimpleNamespace(knobs=knobs, values={})
    of: Any = SimpleNamespace(final=final, problem=SimpleNamespace(data=None), space=None, forms={term: "line"})
    monkeypatch.setattr(causes, "covariance", lambda *_: np.array([[1.0, -1.0], [-1.0, 4.0]]))
    monkeypatch.setattr(causes, "blocks_of", lambda *_, **__: None)
    monkeypatch.setattr(causes, "fitted_law", lambda *given: given[-1])
    settings: Any = SimpleNamespace(fit=None)
    spread = causes._law(of, term, np.array([3.0, 1.0]), settings)
    np.testing.assert_allclose(spread, [[9.0, -3.0], [-3.0, 4.0]])
