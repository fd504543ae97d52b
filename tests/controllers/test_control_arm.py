"""The arm under MPC and LQR: its tool on a path, joints within limits, unknown constants taken out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controllers.converged import converged
from controllers.lqr import build_lqr
from controllers.mpc import build_mpc
from controllers.riccati import controlled, dlqr, linearise, steady_motion, with_last_command
from controllers.settings import Limits, MpcSettings, Soft
from plants.scaler_arm.kinematics.geometry import HOME, SCALER
from plants.scaler_arm.servo_robot import ServoArm
from residual_mpc.errors import BadInput
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import read_robot_file
from residual_mpc.models.settings import Knob
from scenarios.arm import CONTROL, DT, Path, circle_line, circle_z

SERVO = ServoArm("scaler_arm_servo")
LATE = {Knob("command_delay", None, "delay"): 0.03, Knob("payload", None, "mass"): 0.1}
FAST = replace(CONTROL, compile=False)


def arm(effects: dict[Knob, float] | None = None, **build: object) -> Augmented:
    return augment(SERVO, effects or {}, None, Build(DT, **build))  # type: ignore[arg-type]


def follow(controller, plant: Augmented, path: Path, steps: int, see=lambda x: x):
    """(errors (steps, 6), commands (steps, 6), joints (steps, 6), outcomes) on a plant that is a model."""
    x, state = plant.start(path.begin()), controller.init()
    errors, commands, joints, outcomes = [], [], [], []
    for k in range(steps):
        reference = path.path(DT * (k + 1 + np.arange(FAST.horizon)))
        command, state, info = controller.step(state, see(x), reference)
        x = plant.numpy_step(x, command)
        errors.append(plant.outputs(x) - reference[0])
        commands.append(command)
        joints.append(x[:6])
        outcomes.append(info.outcome)
    return np.array(errors), np.array(commands), np.array(joints), outcomes


def off(errors: np.ndarray) -> float:
    """RMS of the distance, m."""
    return float(np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, axis=1))))


@pytest.mark.parametrize("path", [circle_line(), circle_z()], ids=["line", "z"])
def test_the_tool_follows_the_path_and_the_gripper_keeps_its_turn(path):
    model = arm(LATE)
    errors, commands, _, outcomes = follow(build_mpc(model, FAST), model, path, 200)
    assert set(outcomes) == {"solved"}
    assert off(errors[50:]) < 1e-4 and np.abs(errors[50:, 3:]).max() < 0.01
    assert np.abs(np.diff(commands, axis=0)).max() <= SCALER.speed * DT + 1e-12


def test_a_model_without_the_delay_and_the_load_follows_worse():
    plant = arm(LATE)
    knows = off(follow(build_mpc(plant, FAST), plant, circle_z(), 150)[0][50:])
    bare = arm()
    blind = follow(build_mpc(bare, FAST), plant, circle_z(), 150, see=lambda x: x[: bare.nx])
    assert off(blind[0][50:]) > 5 * knows


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("dead_zone", {"width": 0.02}),
        ("coulomb_friction", {"torque": 0.15}),
        ("stribeck_friction", {"static": 0.2, "kinetic": 0.1, "velocity": 0.2}),
        ("load_dependent_friction", {"coefficient": 0.1}),
    ],
)
def test_what_swallows_commands_is_driven_through(effect, values):
    robot = load_robot(read_robot_file("scaler_arm"))
    bare = augment(robot, {}, None, Build(DT))
    plant = augment(robot, {Knob(effect, None, name): v for name, v in values.items()}, None, Build(DT))
    shared = [plant.stepped.states.index(s) for s in bare.stepped.states]
    knows = off(follow(build_mpc(plant, FAST), plant, circle_z(), 100)[0][50:])
    blind = off(follow(build_mpc(bare, FAST), plant, circle_z(), 100, see=lambda x: x[shared])[0][50:])
    assert knows < 0.5 * blind


def test_joint_limits_hold_on_commands_to_the_last_bit_and_on_angles_by_their_price():
    model = arm()
    low, high = np.array(HOME) - 0.12, np.array(HOME) + 0.12
    wall = Soft("position.shoulder", -0.1, 0.1, price=1e4, square=1e6)
    limits = Limits(tuple(low), tuple(high), 2.0, (wall,))
    errors, commands, joints, outcomes = follow(build_mpc(model, replace(FAST, limits=limits)), model, circle_z(), 250)
    free = follow(build_mpc(model, FAST), model, circle_z(), 250)[2]
    assert "shifted" not in outcomes
    assert (commands >= low).all() and (commands <= high).all() and np.isclose(commands, high).any()
    assert np.abs(np.diff(commands, axis=0)).max() <= 2.0 * DT + 1e-12
    assert np.abs(free[:, 0]).max() > 0.13 and np.abs(joints[:, 0]).max() < 0.102
    assert off(errors) > 1e-3, "the limits must matter, or the test says nothing"


def test_unknown_constants_are_taken_out():
    """A load that the model has not is a rate that it has not: an estimator that finds it lets the MPC undo it."""
    plant, model = arm({Knob("payload", None, "mass"): 0.1}), arm(disturbances=True)
    rates = plant.numpy_step(plant.start(), np.array(HOME))[:6] - arm().numpy_step(arm().start(), np.array(HOME))[:6]

    def see(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[:6], rates / DT])

    path = Path(circle_z().motion)
    with_them = off(follow(build_mpc(model, FAST), plant, path, 150, see)[0][50:])
    without = off(follow(build_mpc(arm(), FAST), plant, path, 150)[0][50:])
    assert with_them < 0.5 * without  # a load is a constant rate only near one posture


def test_lqr_brings_the_arm_back_to_its_trajectory():
    model = arm(LATE)
    path, n = circle_line(), 150
    lqr = build_lqr(model, path.path(DT * np.arange(n + 20)), FAST, path.begin())
    x, state = lqr.x[0].copy(), lqr.init()
    x[:6] += [0.05, -0.03, 0.02, 0.05, -0.05, 0.1]
    away = []
    for _ in range(n):
        u, state, _ = lqr.step(state, x, np.zeros((1, 6)))
        x = model.numpy_step(x, u)
        away.append(np.linalg.norm((model.outputs(x) - model.outputs(lqr.x[state.sample]))[:3]))
    assert away[0] > 0.01 and max(away[80:]) < 2e-4
    assert np.isfinite(lqr.step(state, np.full(model.nx, np.nan), np.zeros((1, 6)))[0]).all()


def test_the_terminal_cost_is_the_cost_to_go():
    """Of the linearised arm at home: x0' P x0 is what the LQR's drive from x0 costs."""
    model = arm(LATE)
    states = controlled(model)
    x, u = steady_motion(model, 0.2)
    np.testing.assert_allclose(model.numpy_step(x, u), x, atol=1e-9)  # held at home
    A, B = linearise(model, x, u)
    A, B = with_last_command(A[np.ix_(states, states)], B[states])
    Q, R = np.eye(len(A)), np.eye(6)
    K, P = dlqr(A, B, Q, R)
    at = np.random.default_rng(0).standard_normal(len(A))
    wanted, cost = at @ P @ at, 0.0
    for _ in range(3000):
        v = -K @ at
        cost += at @ Q @ at + v @ R @ v
        at = A @ at + B @ v
    np.testing.assert_allclose(cost, wanted, rtol=1e-8)


def test_one_iteration_is_near_the_converged_solution():
    model = arm(LATE)
    mpc = build_mpc(model, replace(FAST, horizon=8))
    path, x = circle_z(), model.start(circle_z().begin())
    x[:6] += [0.02, -0.01, 0.01, 0.02, 0.0, 0.0]
    reference = path.path(DT * (60 + np.arange(8)))
    _, state, _ = mpc.step(mpc.init(), x, reference)
    sent = model.hold(x)
    plan, _, good = converged(mpc).solve(x, sent, reference, state.plan)
    assert good
    np.testing.assert_allclose(state.plan[0], plan[0], atol=1e-3)


def test_what_does_not_fit_is_refused():
    with pytest.raises(BadInput, match="weights.error must have 6 entries"):
        build_mpc(arm(), MpcSettings())
    with pytest.raises(BadInput, match="one for each of 6 commands"):
        build_mpc(arm(), replace(FAST, limits=Limits((-1.0, -1.0), (1.0, 1.0))))
    with pytest.raises(BadInput, match="soft limit"):
        build_mpc(arm(), replace(FAST, limits=replace(CONTROL.limits, soft=(Soft("pose.x", 0.0, 1.0),))))


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_garbage_in_gives_a_command_within_limits(poison):
    mpc = build_mpc(arm(LATE), FAST)
    low, high = (np.array(v) for v in (CONTROL.limits.lower, CONTROL.limits.upper))
    path = circle_z()
    start, ahead = mpc.model.start(path.begin()), path.path(DT * (1 + np.arange(20)))
    _, state, _ = mpc.step(mpc.init(), start, ahead)
    bad = start.copy()
    bad[2] = poison
    command, state, info = mpc.step(state, bad, ahead)
    assert info.outcome == "shifted" and np.isfinite(state.plan).all()
    assert (command >= low).all() and (command <= high).all()


@pytest.mark.parametrize("poison", [np.nan, np.inf])
def test_a_first_state_that_is_not_finite_is_refused_and_a_first_reference_holds_the_arm(poison):
    mpc = build_mpc(arm(LATE), FAST)
    path = circle_z()
    start, ahead = mpc.model.start(path.begin()), path.path(DT * (1 + np.arange(20)))
    bad = start.copy()
    bad[2] = poison
    with pytest.raises(BadInput, match=f"finite at the first sample, when there is no plan .* got .* {poison}"):
        mpc.step(mpc.init(), bad, ahead)
    command, state, info = mpc.step(mpc.init(), start, np.full_like(ahead, poison))
    assert info.outcome == "shifted" and state.samples == 1
    np.testing.assert_array_equal(command, mpc.model.hold(start))
