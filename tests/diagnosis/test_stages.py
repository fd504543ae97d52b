"""How much of the gap each stage makes: shares that add up, whatever the order in which effects are added."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from diagnosis.linear import ROVER, SCALE, fitted, space_of
from oracles.rover_log import SIGMA, rover_run

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, measure_scales
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.results.records import GapStep, StageShare
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.stages import shapley, squared_gaps, stage_shares, staged
from residual_mpc.models.settings import Knob, Term

TUNED = ResultSettings()

TRACK, DELAY, SLIP = Term("track_width", None), Term("command_delay", None), Term("lateral_slip", None)
TERMS = (TRACK, DELAY, SLIP)
LATE = Knob("command_delay", None, "delay")
ALL = 10_000_000  # simulation steps: every window


def by_stage(shares: tuple[StageShare, ...]) -> dict[str, float]:
    return {s.name: s.share for s in shares}


def subsets(terms: tuple[Term, ...]) -> list[frozenset[Term]]:
    return [frozenset(c) for n in range(len(terms) + 1) for c in combinations(terms, n)]


def shapley_literal(gaps: dict[frozenset[Term], float], terms: tuple[Term, ...]) -> dict[Term, float]:
    """The mean over all orders of what adding a term takes away."""
    orders = list(permutations(terms))
    out = dict.fromkeys(terms, 0.0)
    for order in orders:
        for n, term in enumerate(order):
            out[term] += (gaps[frozenset(order[:n])] - gaps[frozenset(order[: n + 1])]) / len(orders)
    return out


@pytest.mark.parametrize("seed", range(3))
def test_a_share_is_the_mean_over_all_orders(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gaps = {s: float(rng.uniform()) for s in subsets(TERMS)}
    found = shapley(gaps, TERMS)
    assert found == pytest.approx(shapley_literal(gaps, TERMS))
    assert sum(found.values()) == pytest.approx(gaps[frozenset()] - gaps[frozenset(TERMS)])


def test_effects_that_add_up_have_their_own_share_and_one_that_does_nothing_has_none() -> None:
    own = {TRACK: 0.5, DELAY: 0.2, SLIP: 0.0}
    gaps = {s: 1.0 - sum(own[t] for t in s) for s in subsets(TERMS)}
    assert shapley(gaps, TERMS) == pytest.approx(own)


def test_effects_that_only_help_together_share_alike() -> None:
    gaps = {s: 0.0 if {TRACK, DELAY} <= s else 1.0 for s in subsets(TERMS)}
    assert shapley(gaps, TERMS) == pytest.approx({TRACK: 0.5, DELAY: 0.5, SLIP: 0.0})


def test_stages_share_the_squared_gap_with_the_noise_and_what_is_left() -> None:
    """0.09 of outliers, 0.5 and 0.2 of effects, 0.21 left, of which 0.01 is noise."""
    drops = {TRACK: 0.5, DELAY: 0.2}
    found = by_stage(stage_shares(drops, after=np.sqrt(0.21), floor=0.1, outliers=0.09))
    wanted = {"contact": 0.5, "command": 0.2, "sensor": 0.09, "noise": 0.01, "unexplained": 0.2}
    assert found == pytest.approx(wanted)
    assert list(found) == sorted(found, key=lambda name: -found[name])


def test_two_effects_of_one_stage_are_one_share_and_a_harmful_one_has_none() -> None:
    drops = {TRACK: 0.5, Term("wheel_radius", None): 0.3, DELAY: -0.1}
    found = by_stage(stage_shares(drops, after=0.0, floor=0.0, outliers=0.0))
    assert found == pytest.approx({"contact": 1.0, "command": 0.0, "noise": 0.0, "unexplained": 0.0})


def test_noise_is_no_more_than_what_is_left() -> None:
    found = by_stage(stage_shares({TRACK: 0.03}, after=0.1, floor=0.3, outliers=0.0))
    assert found == pytest.approx({"contact": 0.75, "noise": 0.25, "unexplained": 0.0})


@pytest.fixture(scope="module")
def rover() -> tuple[Dataset, Scales, Space, Fit]:
    faults = {"track_width": {"scale": 1.3}, "command_delay": {"delay": 0.06}}
    data = build_dataset([rover_run("one", faults, 12.0, seed=2)], [ROVER], SIGMA)
    space = space_of(data)
    fit = fitted(build_problem(data, space, data.sigma), {SCALE: 1.2, LATE: 0.05})
    return data, measure_scales(data), space, fit


def gap(data: Dataset, scales: Scales, space: Space, values: dict[Knob, float]) -> float:
    return gap_of(data, scales, data.y - predict(data, space.settings([values]))[0]).total


def test_the_gap_falls_from_that_of_the_model_to_that_of_the_explanation(
    rover: tuple[Dataset, Scales, Space, Fit],
) -> None:
    data, scales, space, fit = rover
    before, after = gap(data, scales, space, {}), gap(data, scales, space, dict(fit.values))
    chain, shares = staged(data, scales, space, fit, (before, after, 0.001), ALL, TUNED)
    assert [len(step.effects) for step in chain] == [0, 1, 2] and set(chain[-1].effects) == set(fit.terms)
    assert chain[0].gap == before and chain[-1].gap == pytest.approx(after)
    alone = gap(data, scales, space, {k: v for k, v in fit.values.items() if k.term == chain[1].effects[0]})
    assert chain[1].gap == pytest.approx(alone) and before > alone > after
    found = by_stage(shares)
    assert sum(found.values()) == pytest.approx(1.0) and set(found) == {"contact", "command", "noise", "unexplained"}
    literal = shapley_literal(squared_gaps(data, scales, space, fit.values, subsets(fit.terms)), fit.terms)
    assert found["contact"] == pytest.approx(literal[TRACK] / before**2)
    assert found["command"] == pytest.approx(literal[DELAY] / before**2)
    assert chain[1].effects == (max(fit.terms, key=lambda t: literal[t]),)  # the largest first
    assert found["noise"] == pytest.approx((0.001 / before) ** 2)


def test_what_jumping_samples_add_to_the_gap_is_the_sensors_share(rover: tuple[Dataset, Scales, Space, Fit]) -> None:
    data, scales, space, fit = rover
    before, after = gap(data, scales, space, {}), gap(data, scales, space, dict(fit.values))
    logged = 1.1 * before  # of the windows as they were logged, with their jumps
    _, shares = staged(data, scales, space, fit, (logged, after, 0.0), ALL, TUNED)
    assert by_stage(shares)["sensor"] == pytest.approx(1.0 - 1.0 / 1.1**2)
    only = staged(data, scales, space, Fit((), (), {}, *[np.zeros(0)] * 5), (logged, after, 0.0), ALL, TUNED)  # type: ignore[arg-type]
    assert only[0] == (GapStep((), logged),)
    assert by_stage(only[1])["sensor"] == pytest.approx(1.0 - (after / logged) ** 2)


def test_without_an_effect_that_helps_all_but_the_noise_is_unexplained(
    rover: tuple[Dataset, Scales, Space, Fit],
) -> None:
    data, scales, space, _ = rover
    chain, shares = staged(data, scales, space, None, (0.5, 0.4, 0.1), ALL, TUNED)
    assert chain == (GapStep((), 0.5),) and by_stage(shares) == pytest.approx({"unexplained": 0.96, "noise": 0.04})
