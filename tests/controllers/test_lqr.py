"""The simulated cost is x0'P x0 on a linear plant; along a trajectory the robot is brought back to it."""

from __future__ import annotations

import numpy as np
from drives import DT, SLOW, drive, figure_eight

from controllers.lqr import backwards, build_lqr
from controllers.riccati import controlled, dlqr, linearise, stage_cost, steady_motion, with_last_command
from controllers.settings import MpcSettings, Weights


def test_the_simulated_cost_is_x0_P_x0():
    rng = np.random.default_rng(0)
    A, B = rng.standard_normal((4, 4)), rng.standard_normal((4, 2))
    Q, R = np.diag([1.0, 2.0, 0.5, 1.0]), np.diag([0.3, 1.0])
    K, P = dlqr(A, B, Q, R)
    x = rng.standard_normal(4)
    wanted, cost = x @ P @ x, 0.0
    for _ in range(400):
        u = -K @ x
        cost += x @ Q @ x + u @ R @ u
        x = A @ x + B @ u
    np.testing.assert_allclose(cost, wanted, rtol=1e-10)


def test_the_recursion_along_a_trajectory_ends_in_the_same_cost():
    rng = np.random.default_rng(1)
    A, B = [rng.standard_normal((3, 3)) for _ in range(15)], [rng.standard_normal((3, 2)) for _ in range(15)]
    Q, R, end = np.eye(3), 0.1 * np.eye(2), 3.0 * np.eye(3)
    gains, costs = backwards(A, B, Q, R, end)
    x = rng.standard_normal(3)
    wanted, cost = x @ costs[0] @ x, 0.0
    for a, b, K in zip(A, B, gains, strict=True):
        u = -K @ x
        cost += x @ Q @ x + u @ R @ u
        x = a @ x + b @ u
    np.testing.assert_allclose(cost + x @ end @ x, wanted, rtol=1e-10)


def test_the_recursion_settles_on_the_riccati_solution_of_the_robot():
    model = drive(SLOW, network=True)
    A, B = linearise(model, *steady_motion(model, 0.2))
    states = controlled(model)
    A, B = with_last_command(A[np.ix_(states, states)], B[states])
    Q, R = stage_cost(Weights(), model, states)
    _, P = dlqr(A, B, Q + 1e-9 * np.eye(len(Q)), R)
    _, costs = backwards([A] * 4000, [B] * 4000, Q + 1e-9 * np.eye(len(Q)), R, np.zeros_like(Q))
    np.testing.assert_allclose(costs[0], P, rtol=1e-5, atol=1e-5 * np.abs(P).max())


def test_it_comes_back_to_the_figure_eight():
    model = drive(SLOW, network=True)
    n = 200
    path = figure_eight(DT * np.arange(n + 20))
    lqr = build_lqr(model, path, MpcSettings(compile=False))
    x, state = lqr.x[0] + 0.0, lqr.init()
    x[:3] += [0.03, -0.02, 0.1]
    away = []
    for _ in range(n):
        u, state, _ = lqr.step(state, x, path[:1])
        assert (np.abs(u) <= 12.0).all()
        away.append(np.hypot(*(x[:2] - lqr.x[state.sample - 1, :2])))
        x = model.numpy_step(x, u)
    assert away[0] > 0.03 and max(away[60:]) < 0.003
    bad = x.copy()
    bad[0] = np.nan
    u, state, info = lqr.step(state, bad, path[:1])
    assert np.isfinite(u).all() and info.outcome == "shifted"
