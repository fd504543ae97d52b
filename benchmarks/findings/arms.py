"""Arms of this benchmark: MuJoCo at 0.5 ms for the rigid bodies; servos, delay, friction, springs outside it.

Dry friction is a bristle that bends up to BEND and then slides, so a joint can rest under load without creeping.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.findings.motions import Array, Rng

STEP = 0.0005  # s
BEND = 0.001  # rad
SETTLING = 1.0  # s under the first command before the log begins

Controller = Callable[[int, Array, Array], Array]  # (tick, q, dq) -> the command of that tick


@dataclass(frozen=True)
class Servos:
    """Position servos: stiffness (N m/rad), damping (N m s/rad), largest torque (N m); motors have the last alone."""

    kp: Array
    kv: Array
    force: Array

    def torque(self, u: Array, q: Array, dq: Array) -> Array:
        """What the motors give; without stiffness the command is the torque."""
        wanted = self.kp * (u - q) - self.kv * dq if self.kp.any() else u
        return np.clip(wanted, -self.force, self.force)


@dataclass(frozen=True)
class Arm:
    """The arm as it is: `xml` with what it carries, and the effects outside the engine, one entry a joint."""

    xml: str
    servos: Servos
    delay: float = 0.0  # s
    friction: Sequence[float] = ()  # N m
    stiffness: Sequence[float] = ()  # N m/rad, of a spring beside the joint
    rest: Sequence[float] = ()  # rad, of the spring
    one_sided: bool = False  # the spring is a cable: it pulls back above `rest` and is slack below


def moved(arm: Arm, controller: Controller, start: Array, seconds: float, rate: float) -> tuple[Array, Array, Array]:
    """Commands, positions and velocities (ticks, joints) at `rate`, from rest at `start`; the first command settles."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(arm.xml)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_EULER
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data = mujoco.MjData(model)
    data.qpos[:] = start
    friction, stiffness, rest = (np.resize(v or [0.0], model.nv) for v in (arm.friction, arm.stiffness, arm.rest))
    ticks, each, late = round(seconds * rate), round(1 / rate / STEP), round(arm.delay / STEP)
    settling = round(SETTLING * rate)
    sent, bend = controller(0, data.qpos.copy(), data.qvel.copy()), np.zeros(model.nv)
    said, q, dq = ([np.zeros(0)] * ticks for _ in range(3))
    waiting = [sent] * late
    for tick in range(-settling, ticks):
        u = controller(max(tick, 0), data.qpos.copy(), data.qvel.copy())
        if tick >= 0:
            said[tick], q[tick], dq[tick] = u, data.qpos.copy(), data.qvel.copy()
        for _ in range(each):
            waiting.append(u)
            torque = arm.servos.torque(waiting.pop(0), data.qpos, data.qvel)
            bend = np.clip(bend + STEP * data.qvel, -BEND, BEND)
            stretch = data.qpos - rest
            pull = stiffness * (np.maximum(stretch, 0.0) if arm.one_sided else stretch)
            data.qfrc_applied[:] = torque - friction * bend / BEND - pull
            mujoco.mj_step(model, data)
    return np.array(said), np.array(q), np.array(dq)


def follow(setpoints: Array) -> Controller:
    """Sends a position servo its setpoints."""
    return lambda tick, q, dq: setpoints[min(tick, len(setpoints) - 1)]


def torque_control(xml: str, setpoints: Array, kp: Array, kv: Array) -> Controller:
    """Torques of a PD law with the gravity of the nominal model, about setpoints."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)

    def sent(tick: int, q: Array, dq: Array) -> Array:
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        return np.asarray(kp * (setpoints[min(tick, len(setpoints) - 1)] - q) - kv * dq + data.qfrc_bias)

    return sent


@dataclass(frozen=True)
class Logging:
    """The log's rate (Hz), the sigmas of position (rad) and velocity (rad/s), the first stamp (s), the stamps' unit."""

    rate: float = 100.0
    position: float = 0.0005
    velocity: float = 0.01
    epoch: int = 0
    nanoseconds: bool = False


def table(arm: Arm, controller: Controller, start: Array, seconds: float, log: Logging, rng: Rng) -> dict[str, Any]:
    """One run's table; the actuator of joint j1 is m1."""
    u, q, dq = moved(arm, controller, start, seconds, log.rate)
    q, dq = q + log.position * rng.standard_normal(q.shape), dq + log.velocity * rng.standard_normal(q.shape)
    ticks = np.arange(len(u))
    each = round(1e9 / log.rate)  # ns
    columns: dict[str, Any] = {
        "t": log.epoch * 10**9 + ticks * each if log.nanoseconds else log.epoch + ticks / log.rate
    }
    for kind, values in (("command.m", u), ("position.j", q), ("velocity.j", dq)):
        columns |= {f"{kind}{k + 1}": values[:, k] for k in range(values.shape[1])}
    return columns
