"""Robots with a residual keep the contract of robots; sums of residuals are sums; the H2 norm's figures."""

from dataclasses import replace

import numpy as np
import pytest
from contracts.cart_plant import Cart

from plants.diff_drive import DiffDrive
from residual_mpc.errors import BadInput
from residual_mpc.learning.cases import add_residuals, check_compatible, sum_residuals
from residual_mpc.learning.forms.registry import form_named
from residual_mpc.learning.forms.residual_robot import residual_robot, with_residual
from residual_mpc.learning.h2 import summary
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models import optional
from residual_mpc.models.contract import check_robot
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", 0.033, 0.16)
CART = Cart("cart", 0.2)


def residual(robot, form: str, seed: int = 0, hidden=(10, 10), size: float = 0.05) -> Residual:
    rng = np.random.default_rng(seed)
    inputs, outputs = form_named(form).inputs(robot), form_named(form).outputs(robot)
    net = Mlp(len(inputs), hidden, len(outputs))
    theta = initial_weights(net, rng) + 0.1 * rng.standard_normal(net.size)
    return Residual(net, theta, inputs, outputs, rng.standard_normal(net.inputs), rng.uniform(0.5, 2.0, net.inputs),
                    size * rng.uniform(0.5, 1.0, net.outputs), form, 0.05, robot.name, 6.0)  # fmt: skip


def drive(steps: int = 100, lead: int = 60, rows: int = 2) -> Drive:
    rng = np.random.default_rng(1)
    return Drive(0.01, lead, np.repeat(rng.uniform(-5, 5, (rows, (lead + steps) // 10, 2)), 10, axis=1), None,
                 np.ones(rows))  # fmt: skip


START = {"pose.x": np.zeros(2), "pose.y": np.ones(2), "pose.theta": np.array([0.3, -2.0])}
POSE = tuple(START)


@pytest.mark.parametrize("form", ["body", "paper"])
def test_a_corrected_wheeled_robot_is_a_robot(form):
    check_robot(residual_robot(ROVER, residual(ROVER, form)), np.random.default_rng(0), 3.0)


def test_a_corrected_joint_robot_is_a_robot():
    robot = residual_robot(CART, residual(CART, "joint"))
    check_robot(robot, np.random.default_rng(0))
    assert optional.actuator_joints(robot) == ("rail",), "what it does not say itself, the robot that it corrects does"


def test_only_the_first_of_a_joint_robots_steps_begins_anew():
    """What no channel tells is warmed up at the window's start, not at each of its steps."""
    seen = []

    class Spy(Cart):
        def replay(self, start, drive, settings, wanted):
            seen.append(drive.midway)
            return super().replay(start, drive, settings, wanted)

    robot = Spy("cart", 0.2)
    r = residual(robot, "joint")
    one = Drive(0.01, 60, np.zeros((1, 160, len(robot.actuators))), None, np.zeros(1))
    states = [c for s in robot.states for c in (s.position, s.velocity)]
    residual_robot(robot, r).replay({c: np.zeros(1) for c in states if c}, one, Settings(1), (states[0],))
    assert seen == [False] + [True] * 19


@pytest.mark.parametrize("form", ["body", "paper"])
def test_a_residual_of_nothing_changes_nothing_but_rounding(form):
    r = residual(ROVER, form)
    quiet = residual_robot(ROVER, r.with_theta(np.zeros(r.net.size)))
    off = residual_robot(ROVER, r.without(r.outputs))
    wanted = ROVER.replay(START, drive(), Settings(2), POSE)
    for c in POSE:
        np.testing.assert_allclose(quiet.replay(START, drive(), Settings(2), POSE)[c], wanted[c], atol=1e-12)
        assert np.array_equal(off.replay(START, drive(), Settings(2), POSE)[c], wanted[c])


def test_the_body_form_is_the_same_in_every_heading():
    robot = residual_robot(ROVER, residual(ROVER, "body"))
    turn = 1.1
    a = robot.replay(START, drive(), Settings(2), POSE)
    turned = {**START, "pose.theta": START["pose.theta"] + turn}
    b = robot.replay(turned, drive(), Settings(2), POSE)
    ax, ay = a["pose.x"] - a["pose.x"][:, :1], a["pose.y"] - a["pose.y"][:, :1]
    np.testing.assert_allclose(b["pose.x"] - b["pose.x"][:, :1], np.cos(turn) * ax - np.sin(turn) * ay, atol=1e-12)
    paper = residual_robot(ROVER, residual(ROVER, "paper"))
    a, b = (paper.replay(s, drive(), Settings(2), POSE) for s in (START, turned))
    assert np.abs((b["pose.theta"] - a["pose.theta"]) - turn).max() > 1e-4


def test_a_linear_body_residual_is_a_first_order_lag():
    """delta = a (previous - model): v_k = (1 - a) model + a previous, from the commands before the window on."""
    form = form_named("body")
    inputs, outputs = form.inputs(ROVER), form.outputs(ROVER)
    net = Mlp(5, (10,), 3, slope=1.0)  # slope 1: no kink, a linear net
    a, r, width = 0.6, 0.033, 0.16
    model = np.array([[r / 2, r / 2], [0, 0], [-r / width, r / width]])
    theta = np.concatenate([np.eye(10, 5).reshape(-1), np.zeros(10),
                            np.concatenate([a * np.eye(3), -a * model, np.zeros((3, 5))], axis=1).reshape(-1),
                            np.zeros(3)])  # fmt: skip
    lag = Residual(net, theta, inputs, outputs, np.zeros(5), np.ones(5), np.ones(3), "body", 0.05, "rover")
    d = replace(drive(), command=np.concatenate([np.zeros((2, 60, 2)), np.full((2, 100, 2), 4.0)], axis=1))
    rolled = form.roll(ROVER, lag, 0.05, START, d, Settings(2), POSE)
    np.testing.assert_allclose(rolled.velocity[0, :, 0], 4.0 * r * (1.0 - a ** np.arange(1, 21)), atol=1e-12)


def test_a_sum_of_residuals_is_one_residual():
    first, second = residual(ROVER, "body", 1), replace(residual(ROVER, "body", 2, (7, 4)), limit=np.inf)
    first = replace(first, limit=np.inf)
    both = add_residuals(first, second)
    z = np.random.default_rng(0).standard_normal((50, 5))
    assert both.net.hidden == (17, 14)
    np.testing.assert_allclose(both(z), first(z) + second(z), atol=1e-12)
    np.testing.assert_allclose(sum_residuals((first, second, first))(z), 2 * first(z) + second(z), atol=1e-12)


def test_residuals_of_another_robot_are_refused():
    joint = residual(CART, "joint")
    with pytest.raises(BadInput, match="cart"):
        with_residual([ROVER], joint)
    with pytest.raises(BadInput, match="other.json"):
        check_compatible(joint, residual(ROVER, "body"), "other.json")


def test_h2_figures_of_a_norm_that_falls_to_a_level():
    norms = np.concatenate([np.full(400, 1.0), np.full(800, 0.1)])  # 20 s at 1, 40 s at 0.1
    h2 = summary(norms, 0.05)
    assert (h2.first, h2.last) == pytest.approx((1.0, 0.1))
    assert h2.converged_after == pytest.approx(20.0 + 10.0, abs=0.2)  # the mean over 10 s has to pass the step
    assert summary(norms[::-1], 0.05).converged_after is None
