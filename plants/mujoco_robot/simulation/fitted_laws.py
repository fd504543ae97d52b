"""Laws on joints, rippling torques and fitted laws: torques and dry frictions that are functions of position, speed,
command, load or time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Effect, Site, Values
from residual_mpc.effects.laws import NEAR, kind_of, quantities_of, shortened
from residual_mpc.effects.library import Effects, present
from residual_mpc.effects.ops import NUMPY, Array
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings, is_null

Signals = Mapping[str, np.ndarray]  # by quantity, (B, joints that can have a law)


@dataclass(frozen=True, eq=False)
class JointLaw:
    """One law where it acts. on: the quantities; joints: places among those that can have a law; p: its parameters
    there, (B, joints)."""

    effect: Effect
    on: tuple[str, ...]
    joints: np.ndarray
    p: Values
    law: Callable[..., Array]

    def at(self, *z: np.ndarray) -> np.ndarray:
        """(B, joints) from the quantities (B, joints that can have a law)."""
        return np.asarray(self.law(NUMPY, self.p, *(x[:, self.joints] for x in z)))


def joint_laws(effects: Effects, site: Site) -> list[JointLaw]:
    """The laws at a site, on the joints where any row has them."""
    out = []
    for effect, p in present(effects, site):
        joints = np.flatnonzero(~is_null(effect.name, p).all(axis=0))
        if len(joints):
            here: Values = {k: v[:, joints] for k, v in p.items()}
            law = effect.step
            kind = kind_of(effect.name)
            if kind is not None:
                here, law = shortened(kind, here)
            assert law is not None
            out.append(JointLaw(effect, quantities_of(effect), joints, here, law))
    return out


def signals_of(batch: Any, robot: CompiledRobot, drive: Drive) -> Callable[[int, np.ndarray, np.ndarray], Signals]:
    """(step, joint speeds (B, njnt), last actuator force (B, nu)) -> what the laws are functions of, at the beginning
    of the step; the time is that of its middle, and command and load of a joint without an actuator are 0."""
    at = [robot.joints.index(j) for j in robot.sites["law"]]
    places, driven = robot.places[at], {int(j): i for i, j in enumerate(robot.driven)}
    sent = [(column, driven[joint]) for column, joint in enumerate(at) if joint in driven]
    columns, actuators = [c for c, _ in sent], [a for _, a in sent]
    q, ctrl = batch.bind("qpos"), batch.bind("ctrl")

    def signals(k: int, speed: np.ndarray, force: np.ndarray) -> Signals:
        command = np.zeros((len(drive.clock), len(at)))
        command[:, columns] = ctrl[:, actuators]
        clock = np.broadcast_to((drive.clock + (k + 0.5) * drive.dt)[:, None], command.shape)
        load = loads(robot, force)[:, at]
        return {"position": q[:, places], "speed": speed[:, at], "command": command, "load": load, "time": clock}

    return signals


def loads(robot: CompiledRobot, force: np.ndarray) -> np.ndarray:
    """(B, joints) N m (N): the torques of the actuators at their joints, from their forces (B, nu), within the joints'
    own limits."""
    out = np.zeros((len(force), len(robot.joints)))
    for i, (joint, ratio) in enumerate(zip(robot.driven, robot.gear_ratios, strict=True)):
        out[:, joint] += ratio * force[:, i]
    limited = robot.model.jnt_actfrclimited[robot.numbers].astype(bool)
    low, high = robot.model.jnt_actfrcrange[robot.numbers].T
    return np.clip(out, np.where(limited, low, -np.inf), np.where(limited, high, np.inf))


def law_torques(batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive) -> Any:
    """(step, joint speeds (B, njnt), force) -> None: writes the laws' torques into the batch; None without laws.

    What brakes ever more with the speed is written as damping, which MuJoCo integrates implicitly.
    """
    laws = joint_laws(settings.effects, "law")
    if not laws:
        return None
    signals = signals_of(batch, robot, drive)
    dofs = robot.dofs[[robot.joints.index(j) for j in robot.sites["law"]]]
    applied = batch.bind("qfrc_applied")
    fast = [law for law in laws if law.on == ("speed",)]
    damping = batch.expand("dof_damping") if fast else None
    base = None if damping is None else damping[:, dofs].copy()

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        now = signals(k, speed, force)
        torque = levels(laws, now)
        if damping is not None and base is not None:
            braking = braking_of(fast, now["speed"])
            damping[:, dofs] = base + braking
            torque = torque + braking * now["speed"]
        applied[:, dofs] = torque

    return update


def levels(laws: Sequence[JointLaw], signals: Signals) -> np.ndarray:
    """(B, joints) the sum of the laws."""
    total = np.zeros_like(signals["position"])
    for law in laws:
        total[:, law.joints] += law.at(*(signals[name] for name in law.on))
    return total


def braking_of(laws: Sequence[JointLaw], speed: np.ndarray) -> np.ndarray:
    """(B, joints) N m s/rad: by how much the laws of the speed fall with it, 0 where they rise."""
    total = np.zeros_like(speed)
    for law in laws:
        total[:, law.joints] += (law.at(speed - NEAR) - law.at(speed + NEAR)) / (2.0 * NEAR)
    return np.maximum(total, 0.0)


def any_law(effects: Effects) -> list[str]:
    """Names of the laws on joints."""
    return [e.name for e, _ in present(effects, "law", "law friction")]
