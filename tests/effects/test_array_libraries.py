"""One equation, three array libraries: numpy, JAX in double precision and CasADi give the same numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from residual_mpc.effects.actuator import (
    backlash_start,
    backlash_step,
    gain_step,
    lag_start,
    lag_step,
    line_limits,
    rate_start,
    rate_step,
    sag_step,
    saturation_step,
)
from residual_mpc.effects.body import (
    coulomb_level,
    gear_level,
    load_level,
    stribeck_level,
    viscous_torque,
)
from residual_mpc.effects.command import breakaway_step, dead_zone_step, delay_start, delay_step
from residual_mpc.effects.contact import radius_over_turn, slope_drift
from residual_mpc.effects.drive import (
    FORWARD_RATE_LIMIT,
    SHARED_LIMIT,
    TURN_GAIN,
    TURN_LIMIT,
    TURN_RATE_LIMIT,
)
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.ground import ground_twist
from residual_mpc.effects.ops import NUMPY, Array, Ops, casadi_ops, jax_ops
from residual_mpc.effects.position_servo import integral_step
from residual_mpc.effects.sensor import mounted, off_axis, unmounted
from residual_mpc.effects.surroundings import ripple_torque, spring_torque

STEPS, N = 20, 5  # steps of a sequence, signals side by side
DT = 0.02  # s
TRACK, RADIUS = 0.16, 0.033  # m
Equation = Callable[..., tuple[Array, ...]]


def delayed(ops: Ops, delay: Array, *u: Array) -> tuple[Array, ...]:
    p, out = {"delay": delay}, []
    memory: Any = delay_start(ops, p, u[0], DT)
    for v in u:
        y, memory = delay_step(ops, p, memory, v, DT)
        out.append(y)
    return tuple(out)


def lagged(ops: Ops, tau: Array, *u: Array) -> tuple[Array, ...]:
    p, out = {"time_constant": tau}, []
    memory = lag_start(ops, p, u[0], DT)
    for v in u:
        y, memory = lag_step(ops, p, memory, v, DT)
        out.append(y)
    return tuple(out)


def slewed(ops: Ops, rate: Array, *u: Array) -> tuple[Array, ...]:
    p, out = {"rate": rate}, []
    memory = rate_start(ops, p, u[0], DT)
    for v in u:
        y, memory = rate_step(ops, p, memory, v, DT)
        out.append(y)
    return tuple(out)


def with_play(ops: Ops, gap: Array, *w: Array) -> tuple[Array, ...]:
    p, out = {"gap": gap}, []
    memory = backlash_start(ops, p, w[0])
    for v in w:
        y, memory = backlash_step(ops, p, memory, v, 0.0, DT)
        out.append(y)
    return tuple(out)


def on_the_ground(
    ops: Ops, scale: Array, ratio: Array, c: Array, track: Array, d: Array, *w: Array
) -> tuple[Array, ...]:
    p = {
        "wheel_radius": {"scale": scale},
        "wheel_radius_mismatch": {"ratio": ratio},
        "longitudinal_slip": {"coefficient": c},
        "track_width": {"scale": track},
        "lateral_slip": {"coefficient": d},
    }
    return ground_twist(ops, p, RADIUS, TRACK, (w[0], w[1]), (100.0 * w[2], 100.0 * w[3]))


def _one(step: Callable[..., Any], *names: str) -> Equation:
    """An equation without memory: parameters first, then the signal."""

    def equation(ops: Ops, *x: Array) -> tuple[Array, ...]:
        p = dict(zip(names, x, strict=False))
        return (step(ops, p, *x[len(names) :]),)

    return equation


def _pair(effect: Effect) -> Equation:
    """An equation of two wheels' speeds, over a sequence: left and right in turn."""
    assert effect.start is not None and effect.step is not None
    (parameter,), start, step = effect.parameters, effect.start, effect.step

    def equation(ops: Ops, value: Array, *u: Array) -> tuple[Array, ...]:
        p, out = {parameter.name: value}, list[Array]()
        memory: Any = start(ops, p, u[0], u[1], DT)
        for left, right in zip(u[::2], u[1::2], strict=True):
            speeds, memory = step(ops, p, memory, left, right, DT)
            out += speeds
        return tuple(out)

    return equation


# name -> equation, ranges of its parameters, number of signals
EQUATIONS: dict[str, tuple[Equation, list[tuple[float, float]], int]] = {
    "command_delay": (delayed, [(0.0, 0.3)], STEPS),
    "actuator_lag": (lagged, [(0.0, 0.4)], STEPS),
    "backlash": (with_play, [(0.0, 0.5)], STEPS),
    "dead_zone": (_one(lambda o, p, u: dead_zone_step(o, p, (), u, DT)[0], "width"), [(0.0, 3.0)], 1),
    "breakaway_loss": (_one(lambda o, p, u: breakaway_step(o, p, (), u, DT)[0], "loss"), [(0.0, 3.0)], 1),
    "actuator_gain": (_one(lambda o, p, y: gain_step(o, p, (), y, 0.0, DT)[0], "gain"), [(0.1, 2.0)], 1),
    "saturation": (_one(lambda o, p, y: saturation_step(o, p, (), y, 0.0, DT)[0], "limit"), [(0.1, 3.0)], 1),
    "voltage_sag": (_one(lambda o, p, y: sag_step(o, p, (), y, 9.0, DT)[0], "rate"), [(0.0, 0.2)], 1),
    "turn_gain": (_pair(TURN_GAIN), [(0.1, 2.0)], 2),
    "turn_limit": (_pair(TURN_LIMIT), [(0.1, 3.0)], 2),
    "shared_limit": (_pair(SHARED_LIMIT), [(0.1, 3.0)], 2),
    "forward_rate_limit": (_pair(FORWARD_RATE_LIMIT), [(1.0, 100.0)], STEPS),
    "turn_rate_limit": (_pair(TURN_RATE_LIMIT), [(1.0, 100.0)], STEPS),
    "coulomb_friction": (_one(coulomb_level, "torque"), [(0.0, 1.0)], 2),
    "viscous_friction": (_one(viscous_torque, "coefficient"), [(0.0, 1.0)], 2),
    "stribeck_friction": (
        _one(stribeck_level, "static", "kinetic", "velocity"),
        [(0.1, 1.0), (0.1, 1.0), (0.1, 2.0)],
        2,
    ),
    "load_dependent_friction": (_one(load_level, "coefficient", "quadratic"), [(0.0, 0.9), (0.0, 2.0)], 2),
    "rate_limit": (slewed, [(1.0, 100.0)], STEPS),
    "torque_speed_limit": (
        lambda o, s, n, w: line_limits(o, {"stall_torque": s, "no_load_speed": n}, w),
        [(0.1, 3.0), (0.5, 3.0)],
        1,
    ),
    "gear_efficiency": (_one(gear_level, "forward", "backward"), [(0.3, 1.0), (0.3, 1.0)], 2),
    "joint_spring": (_one(spring_torque, "stiffness", "rest"), [(0.0, 3.0), (-1.0, 1.0)], 1),
    "torque_ripple": (
        _one(ripple_torque, "amplitude", "cycles", "phase", "lead"),
        [(0.0, 3.0), (1.0, 40.0), (-3.0, 3.0), (0.0, 0.1)],
        2,
    ),
    "servo_integral": (_one(lambda o, p, x, e: integral_step(o, p, x, e, DT), "gain"), [(0.0, 9.0)], 2),
    "ground": (on_the_ground, [(0.5, 2.0), (0.8, 1.2), (0.0, 2.0), (0.5, 2.0), (-0.5, 0.5)], 4),
    "slope": (lambda o, r, h: slope_drift(o, {"rate": r, "heading": h}), [(0.0, 0.1), (-4.0, 4.0)], 0),
    "wheel_eccentricity": (_one(radius_over_turn, "amplitude", "phase"), [(0.0, 0.5), (-4.0, 4.0)], 1),
    "encoder_eccentricity": (_one(off_axis, "amplitude", "phase"), [(0.0, 0.5), (-4.0, 4.0)], 1),
    "mounted": (lambda o, x, y, *q: mounted(o, {"x": x, "y": y}, *q), [(-1.0, 1.0)] * 2, 3),
    "unmounted": (lambda o, x, y, *q: unmounted(o, {"x": x, "y": y}, *q), [(-1.0, 1.0)] * 2, 3),
}


def inputs(name: str) -> tuple[Equation, list[np.ndarray]]:
    equation, ranges, signals = EQUATIONS[name]
    rng = np.random.default_rng(len(name))
    parameters = [rng.uniform(low, high, N) for low, high in ranges]
    for p, (low, _) in zip(parameters, ranges, strict=True):
        p[0] = low  # the end of the range: the null value, where that is 0
    return equation, [*parameters, *(2.0 * rng.standard_normal((signals, N)))]


@pytest.fixture
def double() -> Iterator[None]:
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.mark.parametrize("name", EQUATIONS)
def test_jax_agrees_with_numpy(name: str, double: None) -> None:
    import jax

    equation, x = inputs(name)
    ops = jax_ops()
    there = jax.jit(lambda *x: equation(ops, *x))(*x)
    for mine, theirs in zip(equation(NUMPY, *x), there, strict=True):
        assert theirs.dtype == np.float64
        np.testing.assert_allclose(np.asarray(theirs), mine, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", EQUATIONS)
def test_casadi_agrees_with_numpy(name: str) -> None:
    casadi = pytest.importorskip("casadi")
    equation, x = inputs(name)
    symbols = [casadi.SX.sym(f"x{i}", N) for i in range(len(x))]
    function = casadi.Function("f", symbols, list(equation(casadi_ops(), *symbols)))
    there = function.call(x)
    for mine, theirs in zip(equation(NUMPY, *x), there, strict=True):
        np.testing.assert_allclose(np.asarray(theirs).ravel(), mine, rtol=1e-12, atol=1e-12)


def test_a_smoothed_sign_is_for_optimisers() -> None:
    casadi = pytest.importorskip("casadi")
    w = np.linspace(-1.0, 1.0, 9)
    np.testing.assert_allclose(np.asarray(casadi_ops(0.1).sign(casadi.DM(w))).ravel(), np.tanh(w / 0.1), atol=1e-15)
    np.testing.assert_array_equal(np.asarray(casadi_ops().sign(casadi.DM(w))).ravel(), np.sign(w))


@pytest.mark.parametrize("name", EQUATIONS)
def test_jax_differentiates_every_equation(name: str, double: None) -> None:
    import jax

    equation, x = inputs(name)
    ops = jax_ops()
    gradients = jax.grad(lambda *x: sum(y.sum() for y in equation(ops, *x)), argnums=tuple(range(len(x))))(*x)
    assert all(np.isfinite(np.asarray(g)).all() for g in gradients)
