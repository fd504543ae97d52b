"""Fits in lockstep: where they end, what a race leaves behind, and what a Jacobian that is only updated costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from residual_mpc.diagnosis.fit.least_squares import Race, fit_all
from residual_mpc.models.settings import TUNE, Knob, Values

A, B, OTHER = (Knob("viscous_friction", joint, "coefficient") for joint in ("a", "b", "c"))
GAIN = Knob("actuator_gain", "a", "gain")
GUESSED = Knob(TUNE, None, "actuator.a.kp")
BENT = np.random.default_rng(0).standard_normal((4, 25, 3))


@dataclass
class Ground:
    """A space of numbers between +-9 whose typical step is 0.1; a gain's null is 1."""

    rough: bool = False

    def scale(self, knob: Knob) -> float:
        return 0.1

    def bounds(self, knob: Knob) -> tuple[float, float]:
        return (0.002, 9.0) if knob == GAIN else (-9.0, 9.0)

    def null(self, knob: Knob) -> float:
        return {GAIN: 1.0, GUESSED: 2.0}.get(knob, 0.0)


@dataclass
class Toy:
    """Residuals (H, W, n) by a function of one hypothesis; counts what was evaluated."""

    one: Callable[[Values], np.ndarray]
    space: Ground = field(default_factory=Ground)
    evaluated: int = 0

    def residuals(self, hypotheses: Sequence[Values]) -> np.ndarray:
        self.evaluated += len(hypotheses)
        return np.array([self.one(h) for h in hypotheses])


def curved(values: Values) -> np.ndarray:
    """(4, 25): least at a = 1.5, b = -0.7; bent as real models are; OTHER does not bring it down."""
    a, b = values.get(A, 0.0) - 1.5, values.get(B, 0.0) + 0.7
    bent = BENT[..., 0] * (a + 0.1 * a * a) + BENT[..., 1] * (np.exp(0.4 * b) - 1.0)
    return np.asarray(bent + 0.01 * BENT[..., 2] + 0.02 * values.get(OTHER, 0.0))


@pytest.mark.parametrize("rough", [False, True])
def test_jumps_of_a_rough_robot_do_not_hide_a_slope(rough: bool) -> None:
    """Jumps each 0.02 of a number, as large as what 0.08 of it changes; two steps lead to its place at 0.5."""
    off = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        slope, jumps = rng.standard_normal((4, 25)), rng.standard_normal((900, 4, 25))

        def jumping(values: Values, slope: np.ndarray = slope, jumps: np.ndarray = jumps) -> np.ndarray:
            return np.asarray(slope * (values[A] - 0.5) + 0.08 * jumps[round(values[A] / 0.02) % 900])

        off.append(abs(fit_all(Toy(jumping, Ground(rough)), [{A: -0.6}], 2)[0].values[A] - 0.5))
    assert (np.median(off) < 0.1) == rough


@pytest.mark.parametrize("secants", [0, 2])
def test_a_guessed_gain_may_be_off_by_decades(secants: int) -> None:
    """A first-order servo of bandwidth kp: its errors saturate on both sides, as those of a gain do."""
    t = np.linspace(0.0, 0.05, 25)

    def servo(values: Values) -> np.ndarray:
        return np.asarray(np.exp(-values[GUESSED] * t) - np.exp(-900.0 * t))[None] * np.ones((4, 1))

    (fit,) = fit_all(Toy(servo), [{GUESSED: 2.0}], 24, 1e-9, secants=secants)
    assert fit.values[GUESSED] == pytest.approx(900.0, rel=0.01)
    slope = (servo({GUESSED: 1.001 * fit.values[GUESSED]}) - fit.r) / (0.001 * fit.values[GUESSED])
    np.testing.assert_allclose(fit.jacobian[..., 0] / fit.scales[0], slope, atol=0.15 * np.abs(slope).max())


@pytest.mark.parametrize("secants", [0, 2])
def test_a_fit_ends_where_the_cost_is_least(secants: int) -> None:
    (fit,) = fit_all(Toy(curved), [{A: 0.1, B: 0.1}], 24, 1e-9, secants=secants)
    assert fit.values[A] == pytest.approx(1.5, abs=0.02) and fit.values[B] == pytest.approx(-0.7, abs=0.02)
    fresh = [(curved({**fit.values, k: fit.values[k] + 0.015}) - fit.r) / 0.15 for k in fit.knobs]
    np.testing.assert_allclose(
        fit.jacobian, np.stack(fresh, axis=-1)
    )  # measured where the fit ends, whatever went before


def test_updates_of_the_jacobian_save_evaluations_and_lose_nothing() -> None:
    """Of eight numbers, each of whose derivatives costs a replay."""
    knobs = [Knob("viscous_friction", f"j{k}", "coefficient") for k in range(8)]
    basis = np.random.default_rng(1).standard_normal((4, 25, 9))

    def bent(values: Values) -> np.ndarray:
        x = np.array([values[k] for k in knobs]) - np.linspace(-1.0, 1.0, 8)
        return np.asarray(basis[..., :8] @ (x + 0.1 * x**2) + 0.05 * basis[..., 8])

    measured, updated = Toy(bent), Toy(bent)
    start: Values = dict.fromkeys(knobs, 0.1)
    (best,) = fit_all(measured, [start], 12, 1e-6, secants=0)
    (fit,) = fit_all(updated, [start], 12, 1e-6)
    assert fit.cost < 1.01 * best.cost
    assert updated.evaluated < 0.8 * measured.evaluated


def test_a_race_leaves_behind_what_cannot_come_first_and_the_winner_as_it_is() -> None:
    starts: list[Values] = [{A: 0.1, B: 0.1}, {A: 0.1}, {OTHER: 1.0}]
    whole, raced = Toy(curved), Toy(curved)
    alone = fit_all(whole, starts, 24, 1e-9)
    first, *others = fit_all(raced, starts, 24, 1e-9, Race(margin=0.5))
    assert first.values == alone[0].values and raced.evaluated < whole.evaluated
    assert all(f.cost >= a.cost and f.cost > first.cost + 0.5 for f, a in zip(others, alone[1:], strict=True))


def test_what_may_still_come_first_is_not_left_behind() -> None:
    """It starts far behind one that is at its end already."""
    far, done = {A: 8.0, B: 6.0}, {B: -0.7}
    fits = fit_all(Toy(curved), [far, done], 24, 1e-9, Race(margin=0.01))
    assert fits[0].cost < 0.1 * fits[1].cost


def test_a_small_gain_is_found() -> None:
    """A step of 0.15 would be ten times what is looked for."""

    def soft(values: Values) -> np.ndarray:
        return np.asarray(BENT[..., 0] * (np.log(values[GAIN]) - np.log(0.013)))

    (fit,) = fit_all(Toy(soft), [{GAIN: 0.04}], 24, 1e-9)
    assert fit.values[GAIN] == pytest.approx(0.013, rel=0.01)


def test_a_fit_nearby_lends_its_derivatives() -> None:
    (parent,) = fit_all(Toy(curved), [{A: 0.1, B: 0.1}], 24, 1e-9)
    start: Values = {**parent.values, OTHER: 0.5}
    alone, helped = Toy(curved), Toy(curved)
    (one,) = fit_all(alone, [start], 1, rough=True)
    (other,) = fit_all(helped, [start], 1, rough=True, near=[parent])
    assert helped.evaluated == alone.evaluated - 2
    assert other.cost == pytest.approx(one.cost, rel=0.02)


def test_only_fresh_thresholds_are_looked_for_on_both_sides() -> None:
    play, width = Knob("backlash", "a", "gap"), Knob("dead_zone", "a", "width")

    def one(values: Values) -> np.ndarray:
        return np.asarray(BENT[..., 0] * (values[play] - 0.3) + BENT[..., 1] * (values[width] - 0.2) + BENT[..., 2])

    start: Values = {play: 0.4, width: 0.3}
    whole, part = Toy(one), Toy(one)
    fit_all(whole, [start], 1, rough=True)
    (fit,) = fit_all(part, [start], 1, rough=True, fresh=[frozenset({width})])
    assert part.evaluated == whole.evaluated - 4 and fit.fresh == frozenset({width})
