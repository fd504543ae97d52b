"""The MPC on an arm of a user's own model file: limits of every kind, and the cost of a single iteration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.own_arms import UR5E, panda

from controllers.converged import converged
from controllers.mpc import build_mpc
from controllers.settings import MpcSettings, Soft
from controllers.usual import usual_settings
from residual_mpc.effects.ops import NUMPY
from residual_mpc.errors import BadInput
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.export.soften import kinks
from residual_mpc.models.settings import Knob

DT = 0.02
EXACT = kinks(NUMPY, 0.0)
KINDS = {
    "position": '<position name="{0}" joint="{0}" kp="120" kv="8" ctrlrange="-2 2"/>',
    "velocity": '<velocity name="{0}" joint="{0}" kv="15" ctrlrange="-3 3"/>',
    "torque": '<motor name="{0}" joint="{0}" ctrlrange="-12 12"/>',
}


def arm(folder: Path, kind: str = "position", smooth: float = 0.0) -> Augmented:
    actuators = "".join(KINDS[kind].format(j) for j in ("j1", "j2"))
    effects = {Knob("command_delay", None, "delay"): 0.03, Knob("payload", None, "mass"): 0.2}
    return augment(robot_of(folder, arm_xml(actuators)), effects, None, Build(DT, smooth))


def wanted(k: int, horizon: int = 20) -> np.ndarray:
    t = DT * (k + 1 + np.arange(horizon))
    slow = np.where(t < 1.0, 0.5 * t * t, t - 0.5)
    return np.stack([0.2 + 0.4 * np.sin(2.0 * slow), 0.5 * np.sin(3.0 * slow)], axis=-1)


def settings(model: Augmented) -> MpcSettings:
    return replace(usual_settings(model), compile=False)


def test_a_step_that_states_no_strengths_limits_no_force(tmp_path: Path) -> None:
    model = arm(tmp_path, next(iter(KINDS)))
    bare = replace(model, stepped=replace(model.stepped, strengths=()))
    names = [{soft.channel for soft in usual_settings(m).limits.soft} for m in (model, bare)]
    assert names[1] == {name for name in names[0] if not name.startswith("effort.")}


@pytest.mark.parametrize("kind", KINDS)
def test_an_arm_follows_its_reference_whatever_drives_it(tmp_path: Path, kind: str) -> None:
    model = arm(tmp_path, kind)
    mpc = build_mpc(model, settings(model))
    x, state, sent, errors = model.start({"position.j1": 0.2}), mpc.init(), [], []
    for k in range(100):
        u, state, info = mpc.step(state, x, wanted(k))
        assert info.outcome == "solved"
        sent.append(u)
        x = model.numpy_step(x, u)
        errors.append(x[:2] - wanted(k)[0])
    assert np.abs(errors[30:]).max() < 0.01
    low, high = mpc.settings.limits.box(2)
    assert (np.array(sent) >= low).all() and (np.array(sent) <= high).all()
    assert (np.abs(np.diff(sent, axis=0)) <= mpc.most + 1e-12).all()


def test_each_command_has_its_own_rate_limit(tmp_path: Path) -> None:
    model = arm(tmp_path)
    plain = settings(model)
    mpc = build_mpc(model, replace(plain, limits=replace(plain.limits, rate=(0.5, 5.0))))
    x, state, sent = model.start(), mpc.init(), [model.hold(model.start())]
    for _ in range(15):
        u, state, _ = mpc.step(state, x, np.full((20, 2), 0.8))
        sent.append(u)
        x = model.numpy_step(x, u)
    most = np.abs(np.diff(sent, axis=0)).max(axis=0)
    assert most[0] == pytest.approx(0.01) and 0.02 < most[1] <= 0.1 + 1e-12


def test_a_joint_keeps_off_its_soft_limit(tmp_path: Path) -> None:
    model = arm(tmp_path)
    plain = settings(model)
    wall = replace(plain.limits, soft=(Soft("position.j2", -0.3, 0.3, price=1e6, square=1e6),))
    reached = []
    for limits in (plain.limits, wall):
        mpc = build_mpc(model, replace(plain, limits=limits))
        x, state, most = model.start(), mpc.init(), 0.0
        for _ in range(40):
            u, state, _ = mpc.step(state, x, np.full((20, 2), 0.6))
            x = model.numpy_step(x, u)
            most = max(most, float(x[1]))
        reached.append(most)
    assert reached[0] > 0.55 and reached[1] < 0.305


@pytest.mark.slow
def test_one_iteration_costs_hardly_more_than_all(tmp_path: Path) -> None:
    model = arm(tmp_path, smooth=1e-3)
    mpc = build_mpc(model, replace(settings(model), limits=replace(settings(model).limits, soft=())))
    solver, costs = converged(mpc), []
    v, w = mpc.settings.weights.of_commands(2)
    for full in (False, True):
        x, state, cost = model.start({"position.j1": 0.2}), mpc.init(), 0.0
        sent = model.hold(x)
        plan = np.tile(sent, (20, 1))
        for k in range(40):
            if full:
                plan, _, good = solver.solve(x, sent, wanted(k), np.vstack([plan[1:], plan[-1:]]))
                assert good
                u = plan[0]
            else:
                u, state, _ = mpc.step(state, x, wanted(k))
            x = model.numpy_step(x, u)
            e = (x[:2] - wanted(k)[0]) / np.array(mpc.settings.weights.error)
            cost += float(e @ e + w @ (u - sent) ** 2 + v @ u**2)
            sent = u
        costs.append(cost)
    assert costs[0] < 1.01 * costs[1]


def test_weights_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    model = arm(tmp_path)
    plain = settings(model)
    with pytest.raises(BadInput, match="2 commands"):
        build_mpc(model, replace(plain, weights=replace(plain.weights, change=(0.1, 0.1, 0.1))))


def test_a_servo_is_spared_the_force_that_it_may_not_give(tmp_path: Path) -> None:
    """A step of the reference asks for far more than 6 N m; the limit holds it there, a little after the kink."""
    model = arm(tmp_path)
    plain = settings(model)
    spared = replace(plain.limits, soft=(Soft("effort.j1", -6.0, 6.0, price=1e4, square=1e4),))
    largest = []
    for limits in (plain.limits, spared):
        mpc = build_mpc(model, replace(plain, limits=limits, first=10))
        x, state, most = model.start(), mpc.init(), 0.0
        for _ in range(40):
            u, state, info = mpc.step(state, x, np.full((20, 2), [-0.5, 0.3]))
            assert info.outcome == "solved"
            most = max(most, abs(float(model.stepped.effort(EXACT, [*x], [*u], [*model.p])[0])))  # type: ignore[misc]
            x = model.numpy_step(x, u)
        largest.append(most)
    assert largest[0] > 9.0 and largest[1] < 6.3


@pytest.mark.slow
@pytest.mark.parametrize("xml", [UR5E, panda()], ids=["ur5e", "panda"])
def test_six_and_seven_joints_never_fail(tmp_path: Path, xml: str) -> None:
    robot = robot_of(tmp_path, xml)
    effects = {Knob("command_delay", None, "delay"): 0.03, Knob("payload", None, "mass"): 0.8}
    model = augment(robot, effects, None, Build(DT))
    mpc = build_mpc(model, usual_settings(model))
    n = len(robot.joints)
    x, state, home = model.start(), mpc.init(), model.start()[:n]
    for k in range(2000):
        t = DT * (k + 1 + np.arange(20))
        swing = 0.2 * np.sin(1.5 * np.minimum(t, 0.5 * t + 0.5))[:, None] * np.cos(0.3 * np.arange(n))
        u, state, info = mpc.step(state, x, home + swing)
        assert info.outcome == "solved"
        x = model.numpy_step(x, u)
    assert np.abs(x[:n] - home - swing[0]).max() < 0.02
