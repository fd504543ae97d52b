"""A stranger's robot in one file: a cart on a rail whose speed follows its command like a first-order system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.effects.actuator import gain_step
from residual_mpc.effects.chain import chain_of, command_chain
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import TUNE, Settings
from residual_mpc.models.stepping import Number, StepOptions, Stepped

ON_COMMANDS = ("command_delay", "actuator_gain")
SPEED = 0.5  # m/s, the largest command


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
        if effect in ON_COMMANDS:
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

    def one_step(self, settings: Settings, options: StepOptions) -> Stepped:
        """The same equations for one step of any length, for controllers and exports; optional."""
        dt, poses = options.dt, ("position.rail", "velocity.rail")
        hosted = {e: p for e, p in settings.effects.items() if e in ON_COMMANDS}
        chain = chain_of(hosted, ("command", "strength"), self.actuators, dt)
        tau = float(settings.tuned.get("time_constant", np.array([self.time_constant]))[0])
        numbers = [Number(TUNE, "", "time_constant", tau, "s")]
        numbers += [Number(e, "motor", q.name, float(p[q.name][0, 0]), q.unit)
                    for e, p in hosted.items() for q in BY_NAME[e].parameters]  # fmt: skip
        at = {(n.effect, n.parameter): i for i, n in enumerate(numbers)}
        states = (*poses, *chain.states)  # a delay line remembers commands

        def values(p: Sequence[Any]) -> Any:
            return lambda effect, target: {q.name: p[at[effect, q.name]] for q in BY_NAME[effect].parameters}

        def step(kinks: Any, x: Sequence[Any], u: Sequence[Any], p: Sequence[Any], correction: Any) -> tuple[Any, ...]:
            now, new = dict(zip(states, x, strict=True)), {}
            sent = chain(kinks, "motor", u[0], values(p), now, new)
            lag = p[at[TUNE, "time_constant"]]
            keep = kinks.exact.exp(-dt / lag)
            away = now["velocity.rail"] - sent
            new["position.rail"] = now["position.rail"] + dt * sent + lag * (1.0 - keep) * away
            new["velocity.rail"] = sent + keep * away
            return tuple(new[name] for name in states)

        still = chain.resting({"motor": 0.0}, values([n.value for n in numbers]))
        return Stepped(
            dt, states, poses[:1], ("m", "m/s", *("m/s" for _ in chain.states)), self.actuators, tuple(numbers), (),
            np.array([still.get(name, 0.0) for name in states]), step, rates=poses[1:], reach=((-SPEED, SPEED),),
            left_out=tuple(f"{e}: an effect of a sensor" for e in settings.effects if e not in hosted),
        )  # fmt: skip


def make(robot: RobotFile) -> Cart:
    """The factory that a robot file names as `cart_plant:make`."""
    return Cart(robot.name, robot.parameters["time_constant"])
