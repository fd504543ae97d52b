"""The step is the replay, CasADi is numpy, derivatives are exact, and weights change without building anew."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from models import DT, EFFECTS, ROBOT, learned, model

from residual_mpc.errors import BadInput
from residual_mpc.export import Build, augment, casadi_model
from residual_mpc.export.agreement import Sampling, agreement, sample
from residual_mpc.models.settings import Knob

ALL = [*EFFECTS, "together"]


def mapped(function, p):
    return lambda x, u: np.array(function.map(len(x))(x.T, u.T, np.tile(p[:, None], len(x)))).T


@pytest.mark.parametrize("name", ALL)
def test_the_step_is_the_replay(name):
    m = model(name)
    a = agreement(m, mapped(casadi_model(m).f, m.p), np.random.default_rng(0))
    assert a.step < 1e-12 and a.replay < 1e-11, a


@pytest.mark.parametrize("form", ["body", "paper"])
def test_the_network_in_the_step_is_the_learned_one(form):
    m = model("without_slope", learned(form))
    a = agreement(m, mapped(casadi_model(m).f, m.p), np.random.default_rng(0))
    assert a.step < 1e-12 and a.network < 1e-13 and a.replay < 1e-9, a
    x, u = sample(m, np.random.default_rng(1), Sampling())
    bare = model("without_slope")
    poses = [m.stepped.states.index(c) for c in m.stepped.poses]
    kept = [m.stepped.states.index(s) for s in bare.stepped.states]
    apart = np.abs(m.numpy_step(x, u) - x)[:, poses] - np.abs(bare.numpy_step(x[:, kept], u) - x[:, kept])[:, poses]
    assert np.abs(apart).max() > 1e-3, "the network must matter, or the test says nothing"


@pytest.mark.parametrize("form", ["body", "paper"])
def test_beyond_the_limit_the_step_is_the_replay_too(form):
    r = learned(form, limit=0.5)
    m = model("without_slope", r)
    c = casadi_model(m)
    a = agreement(m, mapped(c.f, m.p), np.random.default_rng(0))
    assert a.step < 1e-12 and a.network < 1e-13 and a.replay < 1e-9, a
    x, u = sample(m, np.random.default_rng(1), Sampling())
    free = casadi_model(model("without_slope", learned(form)))
    apart = np.abs(mapped(c.f, m.p)(x, u) - mapped(free.f, m.p)(x, u)).max(axis=1)
    assert (apart > 1e-4).mean() > 0.3, "the limit must matter, or the test says nothing"
    again = agreement(m, mapped(free.f, m.p), np.random.default_rng(0))
    assert again.step > 1e-3, "an export without the limit has to be found out"


def test_a_limit_far_off_is_looked_at_as_well():
    """The limit that `learn` writes is six scales: commands of 60 rad/s, which no sampled drive would come to."""
    m = model("none", learned(limit=6.0))
    free = casadi_model(model("none", learned()))
    assert agreement(m, mapped(free.f, m.p), np.random.default_rng(0)).step > 1e-3
    assert agreement(m, mapped(casadi_model(m).f, m.p), np.random.default_rng(0)).largest < 1e-9


@pytest.mark.parametrize("name", ["turn_limit", "shared_limit", "forward_rate_limit", "turn_rate_limit"])
@pytest.mark.parametrize("limit", [2.0, 40.0, math.inf])
def test_a_smoothed_limit_of_both_wheels_is_off_by_the_width_at_most(name, limit):
    number = {"rate": limit / DT} if "rate" in name else {"limit": limit}
    eps, value = 0.1, {Knob(name, None, parameter): v for parameter, v in number.items()}
    exact, rounded = (augment(ROBOT, value, None, Build(DT, smooth)) for smooth in (0.0, eps))
    sides = np.array([0.0, 0.3, 1.0, 2.0, 5.0, 39.0, 41.0, 60.0])
    for u in np.array(np.meshgrid(sides, -sides)).reshape(2, -1).T:
        moved = [np.array(m.numpy_step(m.start(), u)) for m in (exact, rounded)]
        speed = np.abs(moved[1] - moved[0])[[0, 2]] / DT  # m/s and rad/s
        assert speed[0] < eps * 0.033 and speed[1] < 2.0 * eps * 0.033 / 0.16


def test_a_smoothed_limit_is_off_by_half_the_width_at_most():
    eps = 1e-2
    m = model("none", learned(limit=0.5), smooth=eps)
    a = agreement(m, mapped(casadi_model(m).f, m.p), np.random.default_rng(5))
    assert a.step < 1e-12 and 0 < a.network < 2 * 0.495 * eps * 10


def test_the_paper_form_adds_to_the_world_velocity():
    """One step by hand: eq. wheel_prop plus delta of the model's world velocity and the commands."""
    r = learned("paper")
    m = augment(ROBOT, {}, r, Build(DT))
    x = m.start({"pose.theta": 0.3})
    u = np.array([4.0, 6.0])
    turning = 0.033 * (u[1] - u[0]) / 0.16
    along = 0.3 + 0.5 * DT * turning
    v = 0.033 * u.mean()
    delta = r(np.array([v * np.cos(along), v * np.sin(along), turning, *u]))
    yaw = turning + delta[2]
    middle = 0.3 + 0.5 * DT * yaw
    wanted = DT * np.array([v * np.cos(middle) + delta[0], v * np.sin(middle) + delta[1], yaw]) + [0, 0, 0.3]
    np.testing.assert_allclose(m.numpy_step(x, u)[:3], wanted, atol=1e-14)


@pytest.mark.parametrize("limit", [np.inf, 0.5])
@pytest.mark.parametrize("smooth", [0.0, 1e-2])
def test_derivatives_are_exact(smooth, limit):
    m = model("together", learned(limit=limit), smooth=smooth)
    c = casadi_model(m)
    x, u = sample(m, np.random.default_rng(2), Sampling(points=20))
    for xi, ui in zip(x, u, strict=True):
        _, a, b = (np.array(v) for v in c.stage(xi, ui, m.p))
        h = 2e-8  # at rest a ramp's curvature jumps
        for j in range(m.nx):
            e = h * np.eye(m.nx)[j]
            difference = (m.numpy_step(xi + e, ui) - m.numpy_step(xi - e, ui)) / (2 * h)
            np.testing.assert_allclose(a[:, j], difference, atol=2e-7)
        for j in range(m.nu):
            e = h * np.eye(m.nu)[j]
            difference = (m.numpy_step(xi, ui + e) - m.numpy_step(xi, ui - e)) / (2 * h)
            np.testing.assert_allclose(b[:, j], difference, atol=2e-7)


def test_numbers_and_weights_change_without_building_anew():
    c = casadi_model(model("command_delay", learned()))
    p = c.p0.copy()
    at = c.p_names.index("command_delay.left.delay")
    p[at] = p[at + 1] = 0.063
    first = c.p_names.index("theta.0")
    p[first:] *= -0.5
    r = learned()
    other = augment(ROBOT, {Knob("command_delay", None, "delay"): 0.063}, r.with_theta(-0.5 * r.theta), Build(DT))
    x, u = sample(other, np.random.default_rng(4), Sampling(points=50))
    np.testing.assert_allclose(mapped(c.f, p)(x, u), other.numpy_step(x, u), atol=1e-13)


def test_a_smoothed_network_is_off_by_what_is_stated():
    eps = 1e-2
    m = model("none", learned(), smooth=eps)
    a = agreement(m, mapped(casadi_model(m).f, m.p), np.random.default_rng(5))
    assert 0 < a.network < 0.495 * eps * 10  # a kink's own error, through two layers of weights of about 1


def test_a_constant_disturbance_moves_the_robot():
    m = model("none", disturbances=True)
    x = m.start()
    x[m.stepped.states.index("disturbance.body.forward")] = 0.1
    for _ in range(20):
        x = m.numpy_step(x, np.zeros(2))
    np.testing.assert_allclose(x[:3], [0.1, 0.0, 0.0], atol=1e-12)


def test_the_model_goes_into_ipopt_when_smoothed():
    """Ten steps to a pose: the smooth kinks let a converging solver converge."""
    m = model("dead_zone", learned(), smooth=1e-1)
    c = casadi_model(m)
    opti = ca.Opti()
    x, u = opti.variable(m.nx, 21), opti.variable(m.nu, 20)
    cost = 0
    for k in range(20):
        opti.subject_to(x[:, k + 1] == c.f(x[:, k], u[:, k], m.p))
        cost += ca.sumsqr(x[:2, k + 1] - ca.DM([0.2, 0.05])) * 100 + 1e-3 * ca.sumsqr(u[:, k])
    opti.subject_to(x[:, 0] == m.start())
    opti.subject_to(opti.bounded(-10, ca.vec(u), 10))
    opti.minimize(cost)
    opti.set_initial(u, 3.0)
    opti.solver("ipopt", {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"})
    end = opti.solve().value(x)[:2, -1]
    assert np.hypot(*(end - [0.2, 0.05])) < 0.02


def test_what_cannot_be_exported_is_refused_with_the_reason():
    class Closed:
        name = "box"

    with pytest.raises(BadInput, match="no symbolic step"):
        augment(Closed(), {}, None, Build(DT))  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="lacks"):
        augment(ROBOT, {Knob("command_delay", "rear", "delay"): 0.1}, None, Build(DT))
    with pytest.raises(ValueError, match="must be > 0"):
        Build(0.0)
