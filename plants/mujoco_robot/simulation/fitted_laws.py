"""Fitted laws on joints: torques and dry frictions that are functions of position, speed, command or time."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.laws import KIND_OF
from residual_mpc.effects.library import Effects, present
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

Signals = Mapping[str, np.ndarray]  # by quantity, (B, joints that can have a law)
Laws = Sequence[tuple[Effect, Values]]


def signals_of(batch: Any, robot: CompiledRobot, drive: Drive) -> Callable[[int, np.ndarray], Signals]:
    """(step, joint speeds (B, njnt)) -> what the laws are functions of, at the beginning of the step; the time is that
    of its middle, and the command of a joint without an actuator 0."""
    at = [robot.joints.index(j) for j in robot.sites["law"]]
    places, driven = robot.places[at], {int(j): i for i, j in enumerate(robot.driven)}
    q, ctrl = batch.bind("qpos"), batch.bind("ctrl")

    def signals(k: int, speed: np.ndarray) -> Signals:
        sent = np.zeros((len(drive.clock), len(at)))
        for column, joint in enumerate(at):
            if joint in driven:
                sent[:, column] = ctrl[:, driven[joint]]
        clock = np.broadcast_to((drive.clock + (k + 0.5) * drive.dt)[:, None], sent.shape)
        return {"position": q[:, places], "speed": speed[:, at], "command": sent, "time": clock}

    return signals


def law_torques(batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive) -> Any:
    """(step, joint speeds (B, njnt), force) -> None: writes the laws' torques into the batch; None without laws.

    What brakes ever more with the speed is written as damping, which MuJoCo integrates implicitly.
    """
    laws = list(present(settings.effects, "law"))
    if not laws:
        return None
    signals = signals_of(batch, robot, drive)
    dofs = robot.dofs[[robot.joints.index(j) for j in robot.sites["law"]]]
    applied = batch.bind("qfrc_applied")
    fast = [(e, p) for e, p in laws if KIND_OF[e.name].on == "speed"]
    damping = batch.expand("dof_damping") if fast else None
    base = None if damping is None else damping[:, dofs].copy()

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        now = signals(k, speed)
        torque = levels(laws, now)
        if damping is not None and base is not None:
            braking = braking_of(fast, now["speed"])
            damping[:, dofs] = base + braking
            torque = torque + braking * now["speed"]
        applied[:, dofs] = torque

    return update


def levels(laws: Laws, signals: Signals) -> np.ndarray:
    """(B, joints) the sum of the laws."""
    total = np.zeros_like(signals["position"])
    for effect, p in laws:
        assert effect.step is not None
        total = total + effect.step(NUMPY, p, signals[KIND_OF[effect.name].on])
    return total


def braking_of(laws: Laws, speed: np.ndarray) -> np.ndarray:
    """(B, joints) N m s/rad: by how much the laws of the speed fall with it, 0 where they rise."""
    total = np.zeros_like(speed)
    for effect, p in laws:
        assert effect.step is not None
        up, down = (effect.step(NUMPY, p, speed + side * NEAR) for side in (1.0, -1.0))
        total = total + (down - up) / (2.0 * NEAR)
    return np.maximum(total, 0.0)


def any_law(effects: Effects) -> list[str]:
    """Names of the laws on joints."""
    return [e.name for e, _ in present(effects, "law", "law friction")]


NEAR = 1e-3  # rad/s, over which a law's slope is taken
