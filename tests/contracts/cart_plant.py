"""A stranger's robot in one file: a cart on a rail whose speed follows its command like a first-order system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.effects.actuator import gain_step
from residual_mpc.effects.chain import command_chain
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings


@dataclass(frozen=True)
class Cart:
    """tau dv/dt = u - v, dx/dt = v; the command u is a speed, m/s."""

    name: str
    time_constant: float  # s
    actuators: tuple[str, ...] = ("motor",)
    command_kinds: tuple[str, ...] = ("velocity",)
    actuator_joints: tuple[str, ...] = ("rail",)
    states: tuple[State, ...] = (State("position.rail", "velocity.rail"),)
    channels: tuple[str, ...] = ("position.rail", "velocity.rail")
    step: float | None = None

    def slots(self, effect: str) -> tuple[str, ...]:
        if effect in ("command_delay", "actuator_gain"):
            return self.actuators
        return {"sensor_bias": ("position.rail",), "sensor_outliers": (self.name,)}.get(effect, ())

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return -np.inf, np.inf

    def reference(self, kind: str, slot: str | None) -> float:
        return 1.0

    def nominal(self) -> Mapping[str, float]:
        return {"time_constant": self.time_constant}

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        u = command_chain(settings.effects, drive.command, drive.lead, drive.dt, np.array([True]))
        if drive.enabled is not None:
            u = u * drive.enabled
        if "actuator_gain" in settings.effects:
            p = {"gain": settings.effects["actuator_gain"]["gain"][:, None, :]}
            u, _ = gain_step(NUMPY, p, (), u, drive.clock, drive.dt)
        u = u[..., 0]
        tau = settings.tuned.get("time_constant", np.full(len(u), self.time_constant))
        keep = np.exp(-drive.dt / tau)
        x, v = np.empty((2, len(u), drive.steps + 1))
        x[:, 0], v[:, 0] = start["position.rail"], start["velocity.rail"]
        for k in range(drive.steps):
            v[:, k + 1] = u[:, k] + keep * (v[:, k] - u[:, k])
            x[:, k + 1] = x[:, k] + drive.dt * u[:, k] + tau * (1.0 - keep) * (v[:, k] - u[:, k])
        output = np.concatenate([u[:, :1], u], axis=1)
        return {c: {"position.rail": x, "velocity.rail": v}.get(c, output) for c in wanted}


def make(robot: RobotFile) -> Cart:
    """The factory that a robot file names as `cart_plant:make`."""
    return Cart(robot.name, robot.parameters["time_constant"])
