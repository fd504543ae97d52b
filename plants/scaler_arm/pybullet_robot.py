"""The arm in PyBullet as the nominal model of a diagnosis: each window stepped by itself, on all cores.

Bullet's position control is a constraint on the speed, solved anew every step: within its torque it cancels friction,
payload and rotor inertia exactly, so that none of them can be seen or is offered as an effect. What is offered acts
before the motor (delay, dead zone, lag), on its torque (saturation), or after it (the sensors).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plants.pybullet_import import import_pybullet
from plants.scaler_arm.engines.pybullet_world import World
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER, Arm
from plants.scaler_arm.kinematics.loop_closure import closed
from plants.scaler_arm.kinematics.skeleton import skeleton
from plants.scaler_arm.robot import with_servo
from residual_mpc.effects.chain import command_chain, limits_of, on_errors
from residual_mpc.effects.effect import Effect, Values
from residual_mpc.effects.library import Sites, slots_of
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.sensor import EVERY_SENSOR
from residual_mpc.models.drawing import Motion
from residual_mpc.models.protocol import Drive, State
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Settings

WORTH_PROCESSES = 20_000  # steps of one simulation: below, starting processes costs more than it brings


@dataclass(frozen=True)
class PybulletRobot:
    """See `residual_mpc.models.protocol.Robot`."""

    name: str
    arm: Arm = SCALER
    actuators: tuple[str, ...] = MOTORS
    command_kinds: tuple[str, ...] = ("position",) * len(MOTORS)

    @property
    def step(self) -> float:
        return self.arm.period

    @property
    def states(self) -> tuple[State, ...]:
        return tuple(State(f"position.{m}", f"velocity.{m}") for m in MOTORS)

    @property
    def channels(self) -> tuple[str, ...]:
        return (*(f"position.{m}" for m in MOTORS), *(f"velocity.{m}" for m in MOTORS))

    @property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        return dict(zip(MOTORS, self.arm.limits, strict=True))

    def skeleton(self, motion: Motion) -> np.ndarray:
        """See residual_mpc.models.drawing.Skeletal."""
        return skeleton(self.arm, motion)

    @property
    def sites(self) -> Sites:
        """Where effects can act."""
        return {
            **dict.fromkeys(("command", "limit", "delay", "filter"), MOTORS),
            **dict.fromkeys(("offset", "range", "encoder"), tuple(f"position.{m}" for m in MOTORS)),
            "clock": (EVERY_SENSOR,),
            "samples": (self.name,),
        }

    def slots(self, effect: str) -> tuple[str, ...]:
        return slots_of(effect, self.sites)

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        return -np.inf, np.inf

    def reference(self, kind: str, slot: str | None) -> float:
        return {"inertia": self.arm.servo.armature, "mass": 0.1, "length": 0.1}.get(kind, 1.0)

    def nominal(self) -> Mapping[str, float]:
        return {}

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        effects, rows = settings.effects, settings.rows
        u = command_chain(effects, drive.command, drive.lead, drive.dt, np.zeros(len(MOTORS), dtype=bool))
        torque = np.full((rows, len(MOTORS)), self.arm.servo.torque)
        limits = limits_of(effects)
        if limits is not None:
            torque = np.minimum(torque, limits[1])
        errors = tuple(on_errors(effects, np.ones(len(MOTORS), dtype=bool)))
        q, v = (np.stack([start[f"{k}.{m}"] for m in MOTORS], axis=-1) for k in ("position", "velocity"))
        task = _Task(self.arm, drive.dt, q, v, np.ascontiguousarray(u), torque, errors, drive.enabled)
        found = _on_all_cores(task) if u.shape[0] * u.shape[1] > WORTH_PROCESSES else _stepped(task)
        kinds = {"position": found[0], "velocity": found[1], "output": found[2]}
        split = {c: c.split(".") for c in wanted}
        return {c: np.ascontiguousarray(kinds[kind][..., MOTORS.index(m)]) for c, (kind, m) in split.items()}


def build(robot: RobotFile) -> PybulletRobot:
    """The robot of a file whose plant is `scaler_arm_pybullet`, or of that name alone.

    Raises BadInput where PyBullet is not installed, and for a parameter that is unknown or not positive.
    """
    import_pybullet()  # missing: said at once
    return PybulletRobot(robot.name, with_servo(SCALER, robot))


@dataclass(frozen=True)
class _Task:
    """Rows to be stepped: angles q and rates v (B, 6), targets u (B, K, 6) rad, torque limits N m (B, 6), effects on
    the servos' errors with their parameters (B, 6), enabled (B, K, 6) of 0 or 1, or None.
    """

    arm: Arm
    dt: float
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    torque: np.ndarray
    errors: tuple[tuple[Effect, Values], ...]
    enabled: np.ndarray | None

    def part(self, at: np.ndarray) -> "_Task":
        on = None if self.enabled is None else self.enabled[at]
        errors = tuple((effect, {k: v[at] for k, v in p.items()}) for effect, p in self.errors)
        return _Task(self.arm, self.dt, self.q[at], self.v[at], self.u[at], self.torque[at], errors, on)


Found = tuple[np.ndarray, np.ndarray, np.ndarray]  # positions rad, rates rad/s, torques N m: (B, K + 1, 6)


def _on_all_cores(task: _Task) -> Found:
    from joblib import Parallel, cpu_count, delayed

    parts = np.array_split(np.arange(len(task.q)), min(cpu_count(), len(task.q)))
    found = Parallel(n_jobs=len(parts))(delayed(_stepped)(task.part(at)) for at in parts)
    q, v, torque = (np.concatenate(x) for x in zip(*found, strict=True))
    return q, v, torque


def _stepped(task: _Task) -> Found:
    rows, steps, n = task.u.shape
    q, v, torque = (np.empty((rows, steps + 1, n)) for _ in range(3))
    world = World(task.arm)
    for row in range(rows):
        world.put(closed(task.q[row], task.v[row], task.arm))
        q[row, 0], v[row, 0] = task.q[row], task.v[row]
        for k in range(steps):
            target = task.u[row, k]
            if task.errors:
                error = target - q[row, k]
                for effect, p in task.errors:
                    assert effect.step is not None
                    error, _ = effect.step(NUMPY, {name: v[row] for name, v in p.items()}, (), error, task.dt)
                target = q[row, k] + error
            on = 1.0 if task.enabled is None else task.enabled[row, k]
            world.servo(target, task.dt, task.torque[row] * on)
            world.step()
            angles, rates = world.joints()
            q[row, k + 1], v[row, k + 1] = angles[:n], rates[:n]
            torque[row, k] = world.torques()
        torque[row, steps] = torque[row, steps - 1]
    world.close()
    return q, v, torque
