"""Tracking, limits, failures and late solvers, and how far one iteration lies from the converged solution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drives import DT, SLOW, drive, figure_eight, follow

from controllers.converged import converged
from controllers.mpc import build_mpc
from controllers.qp import Qp
from controllers.riccati import dlqr, linearise
from controllers.settings import Limits, MpcSettings, Soft, Weights
from controllers.soft import softened
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import Knob

SLUGGISH = {Knob("forward_rate_limit", None, "rate"): 5.0, Knob("turn_rate_limit", None, "rate"): 4.0}  # rad/s^2
FAST = MpcSettings(compile=False)  # the virtual machine: no test waits for a compiler but the one that compares


@pytest.mark.parametrize("solver", ["osqp", "daqp"])
@pytest.mark.parametrize("network", [False, True])
def test_it_follows_a_figure_eight(solver, network):
    model = drive(SLOW, network)
    errors, _, outcomes, _ = follow(build_mpc(model, replace(FAST, solver=solver)), model, 200)
    assert set(outcomes) == {"solved"}
    assert errors[40:].max() < 0.01


@pytest.mark.parametrize("effects", [SLOW, SLUGGISH], ids=["late", "limited"])
def test_a_model_without_the_effects_follows_worse(effects):
    plant = drive(effects)
    knows = follow(build_mpc(plant, FAST), plant, 200)[0]
    mpc = build_mpc(drive(), FAST)
    state, x = mpc.init(), plant.start({"pose.theta": float(figure_eight(np.zeros(1))[0, 2])})
    worse = []
    for k in range(200):
        seen = x[:3]
        reference = figure_eight(DT * (k + 1 + np.arange(20)))
        command, state, _ = mpc.step(state, seen, reference)
        x = plant.numpy_step(x, command)
        worse.append(np.hypot(*(x[:2] - reference[0, :2])))
    assert np.sqrt(np.mean(np.square(worse[40:]))) > 1.5 * np.sqrt(np.mean(np.square(knows[40:])))


def test_limits_on_commands_hold_to_the_last_bit():
    model = drive(SLOW)
    limits = Limits(-5.0, 5.5, rate=20.0)
    mpc = build_mpc(model, replace(FAST, limits=limits))
    state, x = mpc.init(), model.start({"pose.x": -0.5, "pose.y": 0.3, "pose.theta": 2.0})
    commands = [np.zeros(2)]
    for k in range(80):
        command, state, _ = mpc.step(state, x, figure_eight(DT * (k + 1 + np.arange(20))))
        x = model.numpy_step(x, command)
        commands.append(command)
    c = np.array(commands)
    assert c.min() >= -5.0 and c.max() <= 5.5 and c.max() > 5.0, "a start far off must reach the limit"
    assert np.abs(np.diff(c, axis=0)).max() <= 20.0 * DT + 1e-12


@pytest.mark.slow
def test_one_iteration_costs_little_over_the_converged_solver():
    model = drive(SLOW, network=True, smooth=1e-2)
    mpc = build_mpc(model, FAST)
    exact = converged(mpc)
    costs = {}
    for which in ("once", "converged"):
        state, x = mpc.init(), model.start(dict(zip(model.stepped.poses, figure_eight(np.zeros(1))[0], strict=True)))
        x[:3] += [0.03, -0.03, 0.2]  # a start off the path, so that there is something to plan
        plan, sent, cost = state.plan, state.sent, 0.0
        for k in range(60):
            reference = figure_eight(DT * (k + 1 + np.arange(20)))
            if which == "once":
                command, state, info = mpc.step(state, x, reference)
                assert info.outcome == "solved"
            else:
                plan, _, good = exact.solve(x, sent, reference, np.concatenate([plan[1:], plan[-1:]]))
                assert good
                command = plan[0]
            x = model.numpy_step(x, command)
            cost += stage(mpc, x, reference[0], command, sent)
            sent = command
        costs[which] = cost
    assert costs["once"] < 1.005 * costs["converged"], costs


def stage(mpc, x, reference, command, sent):
    """The closed-loop cost of a sample, in the controller's own terms."""
    e = x[mpc.poses] - reference
    c, s = np.cos(reference[2]), np.sin(reference[2])
    e = np.array([c * e[0] + s * e[1], -s * e[0] + c * e[1], np.remainder(e[2] + np.pi, 2 * np.pi) - np.pi])
    w: Weights = mpc.settings.weights
    return np.sum((e / w.error) ** 2) + np.sum((command - sent) ** 2) / w.change**2 + np.sum(command**2) / w.command**2


def test_the_program_is_the_converged_problem_at_its_solution():
    """At the optimum of the full problem another iteration changes nothing: same cost, same constraints."""
    model = drive(SLOW, network=True, smooth=1e-2)
    limits = Limits(-4.0, 4.0, 40.0, (Soft("pose.y", -0.05, 0.05),))
    mpc = build_mpc(model, replace(FAST, limits=limits, solver="daqp"))
    reference = figure_eight(DT * (1 + np.arange(20)))
    x = model.start({"pose.theta": 0.9, "pose.y": 0.04})
    plan, _, good = converged(mpc).solve(x, np.zeros(2), reference, np.zeros((20, 2)))
    assert good
    qp, soft = mpc._program(x, plan, np.zeros(2), reference)
    assert soft is not None
    qp = softened(qp, soft)
    z, status = mpc.init().engine.solve(qp)
    assert status == "solved"
    np.testing.assert_allclose(z[:40], 0.0, atol=2e-3)


def test_a_soft_limit_is_kept_where_it_can_be_and_passed_where_it_cannot():
    model = drive()
    wall = Limits(soft=(Soft("pose.y", -0.05, 0.05, price=2e4, square=1e4),))  # dearer than any error
    mpc = build_mpc(model, replace(FAST, limits=wall))
    start = {"pose.theta": float(figure_eight(np.zeros(1))[0, 2])}

    def sideways(mpc, at):
        state, x = mpc.init(), model.start(at)
        out = []
        for k in range(150):
            command, state, info = mpc.step(state, x, figure_eight(DT * (k + 1 + np.arange(20))))
            assert info.outcome != "shifted"
            x = model.numpy_step(x, command)
            out.append(x[1])
        return np.array(out)

    free = sideways(build_mpc(model, FAST), start)
    kept = sideways(mpc, start)
    assert np.abs(free).max() > 0.15 and np.abs(kept).max() < 0.06
    outside = sideways(mpc, {**start, "pose.y": 0.3})  # no command brings it inside at once: still a plan
    assert abs(outside[0]) > 0.05 and np.abs(outside[60:]).max() < 0.06


class Broken:
    """A solver whose every third answer is NaN, failed or late."""

    def __init__(self, inner, how):
        self.inner, self.how, self.count = inner, how, 0

    def solve(self, qp: Qp):
        self.count += 1
        if self.count % 3:
            return self.inner.solve(qp)
        if self.how == "late":
            import time

            time.sleep(0.3)
            return self.inner.solve(qp)
        return np.zeros(len(qp.g)), "failed"


@pytest.mark.parametrize("how", ["failed", "late"])
def test_a_failed_solve_sends_the_shifted_plan(how):
    model = drive(SLOW)
    mpc = build_mpc(model, replace(FAST, first=1, budget=0.25))
    state = mpc.init()
    state = replace(state, engine=Broken(state.engine, how))
    x = model.start(dict(zip(model.stepped.poses, figure_eight(np.zeros(1))[0], strict=True)))
    for k in range(1, 16):
        before = state
        command, state, info = mpc.step(state, x, figure_eight(DT * (k + np.arange(20))))
        if k % 3 == 0:
            assert info.outcome == "shifted" and info.failures == k // 3
            np.testing.assert_array_equal(command, before.plan[1])
            np.testing.assert_array_equal(state.plan[:-1], before.plan[1:])
        x = model.numpy_step(x, command)
    error = x[:2] - figure_eight(np.array([15 * DT]))[0, :2]
    assert np.hypot(*error) < 0.02, "a good plan survives a missed solve"


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")
@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e200])
def test_garbage_in_gives_a_command_within_limits(poison):
    model = drive(SLOW)
    mpc = build_mpc(model, FAST)
    state, x = mpc.init(), model.start()
    _, state, _ = mpc.step(state, x, figure_eight(DT * (1 + np.arange(20))))
    for where in range(model.nx):
        bad = x.copy()
        bad[where] = poison
        command, state, info = mpc.step(state, bad, figure_eight(DT * (1 + np.arange(20))))
        assert np.isfinite(command).all() and (np.abs(command) <= 12.0).all()
        assert np.isfinite(state.plan).all()


@pytest.mark.parametrize(
    ("x", "reference", "said"),
    [
        (2, (20, 3), r"x must have shape \(3,\), got \(2,\). Give pose.x, pose.y, pose.theta in this order"),
        (3, (20, 2), r"reference must have shape \(20, 3\), a row for each of the next 20 samples, got \(20, 2\)"),
        (3, (3,), r"got \(3,\). Give pose.x, pose.y, pose.theta in each row"),
    ],
)
def test_arrays_of_another_shape_are_refused(x, reference, said):
    mpc = build_mpc(drive({}), FAST)
    with pytest.raises(BadInput, match=said):
        mpc.step(mpc.init(), np.zeros(x), np.zeros(reference))


def test_the_same_input_gives_the_same_command_bit_for_bit():
    model = drive(SLOW, network=True)
    mpc = build_mpc(model, FAST)
    first, second = follow(mpc, model, 60)[1], follow(mpc, model, 60)[1]
    np.testing.assert_array_equal(first, second)


def test_compiled_and_virtual_machine_agree():
    model = drive(SLOW, network=True)
    a = follow(build_mpc(model, replace(FAST, compile=True)), model, 30)[1]
    b = follow(build_mpc(model, FAST), model, 30)[1]
    np.testing.assert_allclose(a, b, atol=1e-6)


def test_other_weights_need_no_building():
    model = drive(SLOW, network=True)
    mpc = build_mpc(model, FAST)
    p = model.p.copy()
    p[model.parameters.index("theta.0") :] = 0.0
    reference, x = figure_eight(DT * (1 + np.arange(20))), model.start({"pose.theta": 0.8})
    swapped = mpc.with_parameters(p).step(mpc.init(), x, reference)[1].plan
    plain = drive(SLOW)
    bare = build_mpc(plain, FAST)
    alone = bare.step(bare.init(), plain.start({"pose.theta": 0.8}), reference)[1].plan
    assert np.abs(swapped - mpc.step(mpc.init(), x, reference)[1].plan).max() > 0.05
    # the plans agree up to the terminal cost, which was worked out with the network's weights
    np.testing.assert_allclose(swapped, alone, atol=0.3)


def test_what_does_not_fit_is_refused():
    with pytest.raises(BadInput, match="weights.error must have 3 entries"):
        build_mpc(drive(), replace(FAST, weights=Weights(error=(1.0, 1.0))))
    with pytest.raises(BadInput, match="soft limit"):
        build_mpc(drive(), replace(FAST, limits=Limits(soft=(Soft("pose.z", 0.0, 1.0),))))
    with pytest.raises(ValueError, match="lower must be below upper|lower below upper"):
        Limits(1.0, -1.0)
    A, B = linearise(drive(), drive().start(), np.zeros(2))  # a robot that stands cannot move sideways
    with pytest.raises(BadInput, match="robot at rest cannot move sideways"):
        dlqr(A, B, np.eye(3), np.eye(2))


def test_osqp_copes_with_soft_limits_of_a_moderate_price():
    model = drive()
    wall = Limits(soft=(Soft("pose.y", -0.05, 0.05, price=10.0, square=100.0),))
    limited = follow(build_mpc(model, replace(FAST, limits=wall, solver="osqp")), model, 80)
    exact = follow(build_mpc(model, replace(FAST, limits=wall)), model, 80)
    assert "shifted" not in limited[2]
    np.testing.assert_allclose(limited[1], exact[1], atol=0.2)
