"""A model to control, and a figure to follow."""

from __future__ import annotations

import numpy as np

from controllers.mpc import Mpc, PlanState
from plants.diff_drive import DiffDrive
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.learning.forms.body import BODY
from residual_mpc.learning.network.mlp import Mlp
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Knob

DT = 0.05  # s
ROBOT = DiffDrive("rover", 0.033, 0.16)
SLOW = {Knob("command_delay", None, "delay"): 0.08, Knob("actuator_lag", None, "time_constant"): 0.1}


def learned() -> Residual:
    rng = np.random.default_rng(3)
    net = Mlp(5)
    names = BODY
    scale = np.array([0.3, 0.1, 2.0, 10.0, 10.0])
    out = np.array([0.02, 0.01, 0.2])
    theta = 0.3 * rng.standard_normal(net.size)
    z = (*(f"previous.{n}" for n in names), "command.left", "command.right")
    return Residual(net, theta, z, names, np.zeros(5), scale, out, "body", DT)


def drive(effects: dict[Knob, float] | None = None, network: bool = False, smooth: float = 0.0) -> Augmented:
    return augment(ROBOT, effects or {}, learned() if network else None, Build(DT, smooth))


def figure_eight(t: np.ndarray, width: float = 0.8, period: float = 12.0) -> np.ndarray:
    """(n, 3) poses at times t (n,) s."""
    w = 2 * np.pi / period
    x, y = 0.5 * width * np.sin(w * t), 0.25 * width * np.sin(2 * w * t)
    dx, dy = 0.5 * width * w * np.cos(w * t), 0.5 * width * w * np.cos(2 * w * t)
    return np.stack([x, y, np.unwrap(np.arctan2(dy, dx))], axis=-1)


def follow(mpc: Mpc, plant: Augmented, steps: int) -> tuple[np.ndarray, np.ndarray, list[str], PlanState]:
    """Errors (steps,) m, commands (steps, 2), outcomes, of perfect knowledge on the plant's own model."""
    state, x = mpc.init(), plant.start(dict(zip(plant.stepped.poses, figure_eight(np.zeros(1))[0], strict=True)))
    errors, commands, outcomes = [], [], []
    for k in range(steps):
        reference = figure_eight(DT * (k + 1 + np.arange(mpc.horizon)))
        command, state, info = mpc.step(state, x, reference)
        x = plant.numpy_step(x, command)
        errors.append(float(np.hypot(*(x[:2] - reference[0, :2]))))
        commands.append(command)
        outcomes.append(info.outcome)
    return np.array(errors), np.array(commands), outcomes, state
