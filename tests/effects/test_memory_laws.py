"""What remembers: the delay line, the lag and the play, against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from residual_mpc.effects.actuator import (
    backlash_start,
    backlash_step,
    lag_sequence,
    lag_start,
    lag_step,
    sag_step,
    saturation_step,
)
from residual_mpc.effects.chain import command_chain, on_command, through_commands
from residual_mpc.effects.command import (
    LONGEST_DELAY,
    dead_zone_step,
    delay_sequence,
    delay_start,
    delay_step,
)
from residual_mpc.effects.ops import NUMPY

RNG = np.random.default_rng(5)


def stepped_delay(delay: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """(B, K, nu) through the line, a step at a time."""
    memory = delay_start(NUMPY, {"delay": delay}, u[:, 0], dt)
    out = np.empty_like(u)
    for k in range(u.shape[1]):
        out[:, k], memory = delay_step(NUMPY, {"delay": delay}, memory, u[:, k], dt)
    return out


@pytest.mark.parametrize("dt", [0.004, 0.01, 0.013])
def test_a_whole_sequence_is_delayed_as_step_by_step(dt: float) -> None:
    u = RNG.standard_normal((4, 120, 2))
    delay = np.array([[0.0, 0.05], [0.0173, LONGEST_DELAY], [dt, 3 * dt], [0.2999, 1e-9]])
    np.testing.assert_allclose(delay_sequence({"delay": delay}, u, dt), stepped_delay(delay, u, dt), rtol=0, atol=1e-12)


def test_a_delay_of_whole_steps_shifts() -> None:
    u = RNG.standard_normal((1, 50, 1))
    out = delay_sequence({"delay": np.array([[0.07]])}, u, 0.01)[0, :, 0]
    np.testing.assert_allclose(out[7:], u[0, :-7, 0], atol=1e-12)
    np.testing.assert_allclose(out[:7], u[0, 0, 0], atol=1e-12)  # the first command, held before its time


def test_a_ramp_is_late_by_the_delay() -> None:
    t = 0.01 * np.arange(100)
    out = delay_sequence({"delay": np.array([[0.1234]])}, t[None, :, None], 0.01)[0, :, 0]
    np.testing.assert_allclose(out[20:], t[20:] - 0.1234, atol=1e-12)


def test_a_delay_longer_than_the_sequence_shows_its_beginning_alone() -> None:
    u = RNG.standard_normal((1, 10, 1))
    out = delay_sequence({"delay": np.array([[0.25]])}, u, 0.01)
    np.testing.assert_array_equal(out, np.full((1, 10, 1), u[0, 0, 0]))


@pytest.mark.parametrize("tau", [0.004, 0.05, 0.6])
def test_the_lag_is_the_exact_first_order_system(tau: float) -> None:
    """Mean over each step and end of each step of tau dy/dt = u - y, by Euler in fine steps."""
    dt, fine, u = 0.02, 20_000, RNG.standard_normal(6)
    p = {"time_constant": np.array(tau)}
    y = lag_start(NUMPY, p, np.array(u[0]), dt)
    z = float(u[0])
    h = dt / fine
    for v in u:
        mean, y = lag_step(NUMPY, p, y, v, dt)
        # Euler under a constant input in closed form
        path = v + (z - v) * (1.0 - h / tau) ** np.arange(fine + 1)
        z = path[-1]
        error = 2.0 * h / tau * np.abs(u).max()  # Euler's is of first order
        assert abs(mean - 0.5 * (path[1:] + path[:-1]).mean()) < error and abs(y - z) < error
    finer = [_euler_end(u, tau, dt, n) for n in (2_000, 4_000)]
    assert abs(finer[1] - y) < 0.55 * abs(finer[0] - y) + 1e-12  # halves: y is the limit


def _euler_end(u: np.ndarray, tau: float, dt: float, n: int) -> float:
    z = float(u[0])
    for v in u:
        for _ in range(n):
            z += dt / n * (v - z) / tau
    return z


def test_the_lag_does_not_depend_on_the_step() -> None:
    """Two steps of half the length: the same end, and the mean of the two means."""
    p, y0, u = {"time_constant": np.array(0.07)}, np.array(-1.0), np.array(0.8)
    mean, end = lag_step(NUMPY, p, y0, u, 0.02)
    first, half = lag_step(NUMPY, p, y0, u, 0.01)
    second, whole = lag_step(NUMPY, p, half, u, 0.01)
    assert whole == pytest.approx(end, abs=1e-15) and 0.5 * (first + second) == pytest.approx(mean, abs=1e-15)


def play(w: np.ndarray, gap: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Wheel speeds and motor-minus-wheel angles (K,) for motor speeds (K,)."""
    p = {"gap": np.array(gap)}
    x = backlash_start(NUMPY, p, np.array(w[0]))
    out, inside = np.empty_like(w), np.empty_like(w)
    for k, v in enumerate(w):
        out[k], x = backlash_step(NUMPY, p, x, np.array(v), 0.0, dt)
        inside[k] = x
    return out, inside


@settings(max_examples=50, deadline=None)
@given(
    w=st.lists(st.floats(-10, 10, allow_subnormal=False), min_size=2, max_size=40),
    gap=st.floats(0.0, 1.0),
    faster=st.sampled_from([0.25, 3.0, 40.0]),
)
def test_laws_of_the_play_operator(w: list[float], gap: float, faster: float) -> None:
    speeds, dt = np.array(w), 0.05
    out, inside = play(speeds, gap, dt)
    assert (np.abs(inside) <= gap / 2 + 1e-12).all()  # the gap is never exceeded
    assert (out * speeds >= -1e-9).all()  # the wheel never moves against the motor
    assert (np.abs(out) <= np.abs(speeds) + 1e-9).all()  # nor faster than it
    again, _ = play(speeds * faster, gap, dt / faster)  # the same path at another pace
    np.testing.assert_allclose(np.cumsum(again) * dt / faster, np.cumsum(out) * dt, rtol=0, atol=1e-9)


def test_a_swing_loses_the_gap_at_each_reversal() -> None:
    w = np.repeat([1.0, -1.0, 1.0], 100)
    out, _ = play(w, 0.3, 0.01)
    turned = [out[i : i + 100].sum() * 0.01 for i in (0, 100, 200)]
    np.testing.assert_allclose(turned, [1.0, -0.7, 0.7], atol=1e-12)


def test_thresholds() -> None:
    u = np.array([-2.0, -0.5, 0.0, 0.49, 0.5, 2.0])
    np.testing.assert_array_equal(
        dead_zone_step(NUMPY, {"width": np.array(0.5)}, (), u, 0.01)[0], [-2, -0.5, 0, 0, 0.5, 2]
    )
    held = saturation_step(NUMPY, {"limit": np.array(0.5)}, (), u, np.zeros(1), 0.01)[0]
    np.testing.assert_array_equal(held, [-0.5, -0.5, 0, 0.49, 0.5, 0.5])
    sag = [sag_step(NUMPY, {"rate": np.array(0.1)}, (), np.array(2.0), np.array(c), 0.01)[0] for c in (0.0, 5.0, 20.0)]
    np.testing.assert_allclose(sag, [2.0, 1.0, 0.0])  # never below zero


def test_the_chain_is_dead_zone_then_delay_then_lag() -> None:
    """Against one pass step by step, also with rows and actuators at null, and only after the lead."""
    u, dt, lead = RNG.standard_normal((3, 90, 2)), 0.01, 40
    effects = {
        "command_delay": {"delay": np.array([[0.0, 0.03], [0.0451, 0.0], [0.2, 0.2]])},
        "dead_zone": {"width": np.array([[0.0, 0.4], [0.4, 0.4], [0.0, 0.0]])},
        "actuator_lag": {"time_constant": np.array([[0.0, 0.0], [0.05, 0.0], [0.1, 0.3]])},
    }
    zone = np.array([True, False])
    width = np.where(zone, effects["dead_zone"]["width"], 0.0)
    passed = np.where(np.abs(u) < width[:, None], 0.0, u)
    late = stepped_delay(effects["command_delay"]["delay"], passed, dt)
    y = late[:, 0]
    wanted = np.empty_like(late)
    for k in range(90):
        wanted[:, k], y = lag_step(NUMPY, effects["actuator_lag"], y, late[:, k], dt)
    came = command_chain(effects, u, lead, dt, zone)
    assert came.shape == (3, 50, 2)
    np.testing.assert_allclose(came, wanted[:, lead:], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(command_chain({}, u, lead, dt, zone), u[:, lead:])


def test_the_lag_of_a_sequence_is_that_of_its_steps() -> None:
    p = {"time_constant": np.array([[0.0, 0.05], [0.2, 0.05], [1e-5, 0.0]])}
    u, dt = RNG.normal(size=(3, 50, 2)), 0.01
    memory = lag_start(NUMPY, p, u[:, 0], dt)
    expected = np.empty_like(u)
    for k in range(u.shape[1]):
        expected[:, k], memory = lag_step(NUMPY, p, memory, u[:, k], dt)
    assert lag_sequence(p, u, dt) == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    "effects", [("command_delay",), ("command_delay", "dead_zone"), ("command_delay", "actuator_lag")]
)
def test_a_chain_of_commands_needs_no_more_lead_than_it_remembers(effects: tuple[str, ...]) -> None:
    """As if every effect had the whole lead."""
    u, lead, dt = RNG.standard_normal((5, 400, 2)), 300, 0.002
    numbers = RNG.uniform(0.0, 0.2, (5, 2))
    numbers[0], numbers[1] = 0.0, LONGEST_DELAY
    names = {"command_delay": "delay", "dead_zone": "width", "actuator_lag": "time_constant"}
    values = {e: {names[e]: numbers} for e in effects}
    whole, direct = u, np.ones(2, dtype=bool)
    for effect, p in on_command(values, direct):
        whole = through_commands(effect, p, whole, dt)
    np.testing.assert_array_equal(command_chain(values, u, lead, dt, direct), whole[:, lead:])


def test_a_ramp_behind_a_dead_time_shows_every_part_of_a_step() -> None:
    """Of the delay the replay knows a tenth of a step, though the command jumps: the ramp is delayed, not its jump."""
    u, dt = np.where(np.arange(60) < 5, 0.0, 1.0)[None, :, None], 0.01
    rate = {"rate_limit": {"rate": np.array([[4.0]])}}
    for delay in (0.03, 0.031, 0.0355, 0.04):
        came = command_chain(rate | {"command_delay": {"delay": np.array([[delay]])}}, u, 0, dt, np.array([True]))
        t = dt * (np.arange(60) + 0.5) - 0.05 - delay  # s after the ramp begins, in the middle of the steps
        inside = (t > dt) & (t < 0.25 - dt)
        np.testing.assert_allclose(came[0, inside, 0], 4.0 * t[inside], atol=1e-12)
