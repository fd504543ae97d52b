"""The joint form: a robot without a correction is itself, whatever it remembers, and a correction is Dyn's affair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from contracts.cart_plant import Cart
from oracles.arms import CHANNELS, arm_xml, random_drive, random_start, robot_of, settings_of

from residual_mpc.learning.forms.joint import JointForm
from residual_mpc.learning.forms.residual_robot import residual_robot
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings

CART = Cart("cart", 0.2)
STEP = 0.02  # s
BOTH = ("position.rail", "velocity.rail")


class Forgetful(Cart):
    """A cart whose push fades with a memory that is no channel: each replay begins it afresh."""

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        fading = np.exp(-drive.dt * np.arange(drive.command.shape[1] - drive.lead) / 0.1)
        command = drive.command.copy()
        command[:, drive.lead :] *= (1.0 - fading)[:, None]
        return super().replay(start, replace(drive, command=command), settings, wanted)


def residual(size: float, robot: Robot = CART) -> Residual:
    form, rng = JointForm(), np.random.default_rng(3)
    inputs, outputs = form.inputs(robot), form.outputs(robot)
    net = Mlp(len(inputs), (10, 10), len(outputs))
    theta = initial_weights(net, rng) + size * rng.standard_normal(net.size)
    zero, one = np.zeros(len(inputs)), np.ones(len(inputs))
    return Residual(net, theta, inputs, outputs, zero, one, np.ones(len(outputs)), "joint", STEP, robot.name, 6.0)


def drive(rows: int, alike: bool = False) -> Drive:
    u = np.repeat(np.random.default_rng(0).uniform(-0.5, 0.5, (rows, 16, 1)), 10, axis=1)
    return Drive(0.01, 60, np.repeat(u[:1], rows, axis=0) if alike else u, None, np.zeros(rows))


def start(rows: int) -> dict[str, np.ndarray]:
    return {"position.rail": np.full(rows, 0.1), "velocity.rail": np.full(rows, 0.2)}


def literal(robot: Cart, r: Residual, d: Drive, at: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """x_{k+1} = Dyn(x_k, u_k) + delta, step by step: right for a robot whose state is all that it remembers."""
    sub = round(r.step / d.dt)
    x, out = dict(at), {c: [at[c][:, None]] for c in BOTH}
    for k in range(0, d.steps, sub):
        u = d.command[:, d.lead + k : d.lead + k + sub]
        delta = r(np.stack([x[BOTH[0]], x[BOTH[1]], u[..., 0].mean(axis=1)], axis=1))
        found = robot.replay(x, Drive(d.dt, 0, u, None, d.clock), Settings(len(u)), BOTH)
        t = d.dt * np.arange(sub + 1)
        whole = {BOTH[0]: found[BOTH[0]] + 0.5 * delta * t**2, BOTH[1]: found[BOTH[1]] + delta * t}
        for c in BOTH:
            out[c].append(whole[c][:, 1:])
        x = {c: whole[c][:, -1] for c in BOTH}
    return {c: np.concatenate(parts, axis=1) for c, parts in out.items()}


@pytest.mark.parametrize("robot", [CART, Forgetful("cart", 0.2)])
def test_a_network_of_zero_changes_nothing_to_the_last_bit(robot: Cart) -> None:
    wanted = robot.replay(start(3), drive(3), Settings(3), BOTH)
    found = residual_robot(robot, residual(0.0)).replay(start(3), drive(3), Settings(3), BOTH)
    for c in BOTH:
        assert np.array_equal(found[c], wanted[c])


@pytest.mark.parametrize("effect", ["joint_compliance", "backlash"])
def test_a_network_of_zero_keeps_the_springs_and_the_play_of_an_arm(effect: str, tmp_path: Path) -> None:
    """With the restart at each step that the form once made, the arm's joints were off by this network alone."""
    arm = robot_of(tmp_path, arm_xml())
    parameter, value = {"joint_compliance": ("stiffness", 20.0), "backlash": ("gap", 0.05)}[effect]
    settings = settings_of(arm, *[{(effect, "j2", parameter): value}] * 2)
    d, begin = random_drive(arm, 2, 200), random_start(arm, 2)
    wanted = arm.replay(begin, d, settings, CHANNELS)
    found = residual_robot(arm, residual(0.0, arm)).replay(begin, d, settings, CHANNELS)
    for c in CHANNELS:
        assert np.array_equal(found[c], wanted[c])


def test_what_a_robot_remembers_acts_beside_a_correction() -> None:
    """The correction adds to the robot's own motion, which no step begins anew."""
    robot, r = Forgetful("cart", 0.2), residual(0.1)
    free = robot.replay(start(2), drive(2), Settings(2), BOTH)
    found = residual_robot(robot, r).replay(start(2), drive(2), Settings(2), BOTH)
    known = residual_robot(CART, r).replay(start(2), drive(2), Settings(2), BOTH)
    plain = CART.replay(start(2), drive(2), Settings(2), BOTH)
    for c in BOTH:
        added, alone = found[c] - free[c], known[c] - plain[c]
        assert 0.5 < np.abs(added).max() / np.abs(alone).max() < 2.0


def test_of_a_robot_that_remembers_nothing_else_it_is_the_papers_equation() -> None:
    r = residual(0.3)
    found = residual_robot(CART, r).replay(start(4), drive(4), Settings(4), BOTH)
    wanted = literal(CART, r, drive(4), start(4))
    free = CART.replay(start(4), drive(4), Settings(4), BOTH)
    for c in BOTH:
        np.testing.assert_allclose(found[c], wanted[c], atol=1e-12)
        assert np.abs(found[c] - free[c]).max() > 1e-2


@pytest.mark.parametrize("robot", [CART, Forgetful("cart", 0.2)])
def test_pushes_of_one_window_share_its_own_motion(robot: Cart) -> None:
    """Together, as one batch of rows that are alike, as each of them alone."""
    form, r, rows = JointForm(), residual(0.1), 5
    push = np.zeros((rows, 50, 1))
    push[np.arange(1, rows), [0, 7, 20, 49], 0] = 0.4
    d = drive(rows, alike=True)
    together = form.roll(robot, r, STEP, start(rows), d, Settings(rows), BOTH, push)
    for k in range(rows):
        alone = form.roll(robot, r, STEP, start(1), d.take(np.array([k])), Settings(1), BOTH, push[k : k + 1])
        for c in BOTH:
            np.testing.assert_allclose(together.nodes[c][k], alone.nodes[c][0], atol=1e-12)
        np.testing.assert_allclose(together.velocity[k], alone.velocity[0], atol=1e-12)
