"""The model in other people's controllers: a plain CasADi Opti problem, do-mpc, and acados' expressions."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from models import learned, model

from residual_mpc.export import casadi_model
from residual_mpc.export.acados import fill_acados

GOAL = np.array([0.25, 0.08])  # m
STEPS = 24


def test_opti():
    m = model("command_delay", learned(), smooth=1e-2)
    c = casadi_model(m)
    opti = ca.Opti()
    x, u, p = opti.variable(m.nx, STEPS + 1), opti.variable(m.nu, STEPS), opti.parameter(len(c.p0))
    for k in range(STEPS):
        opti.subject_to(x[:, k + 1] == c.f(x[:, k], u[:, k], p))
    opti.subject_to(x[:, 0] == m.start())
    opti.subject_to(opti.bounded(-8, ca.vec(u), 8))
    opti.minimize(1000 * ca.sumsqr(x[:2, -1] - GOAL) + 1e-4 * ca.sumsqr(u))
    opti.set_initial(u, 3.0)
    opti.solver("ipopt", {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"})
    ends = []
    for values in (c.p0, np.where(np.array(c.p_names) == "tune.wheel_radius", 0.04, c.p0)):
        opti.set_value(p, values)  # other numbers, no rebuilding
        solution = opti.solve()
        plan = solution.value(u).T
        assert np.hypot(*(solution.value(x)[:2, -1] - GOAL)) < 0.02
        ends.append(np.abs(plan).mean())
    assert ends[1] < ends[0], "larger wheels need to turn less"


def test_do_mpc():
    pytest.importorskip("do_mpc")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from do_mpc.controller import MPC
        from do_mpc.model import Model

        m = model("actuator_lag", learned(), smooth=1e-2)
        c = casadi_model(m)
        inner = Model("discrete", "SX")
        x = inner.set_variable("_x", "x", shape=(m.nx, 1))
        u = inner.set_variable("_u", "u", shape=(m.nu, 1))
        inner.set_rhs("x", c.f(x, u, m.p))
        inner.setup()
        outer = MPC(inner)
        quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
        outer.set_param(n_horizon=12, t_step=m.build.dt, store_full_solution=False, nlpsol_opts=quiet)
        error = ca.sumsqr(x[:2] - GOAL)
        outer.set_objective(lterm=error, mterm=10 * error)
        outer.set_rterm(u=1e-4)
        outer.bounds["lower", "_u", "u"], outer.bounds["upper", "_u", "u"] = -8.0, 8.0
        outer.setup()
        state = m.start({"pose.theta": 0.3})
        outer.x0 = state
        outer.set_initial_guess()
        for _ in range(40):
            state = m.numpy_step(state, np.array(outer.make_step(state[:, None])).ravel())
    assert np.hypot(*(state[:2] - GOAL)) < 0.03


def test_acados_expressions():
    c = casadi_model(model("command_delay", learned(limit=0.5)))
    filled = fill_acados(SimpleNamespace(), c)
    again = ca.Function("again", [filled.x, filled.u, filled.p], [filled.disc_dyn_expr])
    rng = np.random.default_rng(0)
    x, u = rng.standard_normal(len(c.x_names)), rng.standard_normal(2)
    np.testing.assert_array_equal(np.array(again(x, u, c.p0)), np.array(c.f(x, u, c.p0)))
    assert filled.name.isidentifier() and filled.x.shape == (len(c.x_names), 1)
