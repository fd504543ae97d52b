"""What is drawn of a SCALER case before any effect: runs and sensors; the arm is always the published one."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm import motions
from plants.blind_families.arm.effects import ArmRobot, ArmSensor
from plants.blind_families.arm.runs import ReferenceMotion, play
from plants.blind_families.arm.setting import Setting
from plants.blind_families.arm.truth import STEP, ideal
from plants.blind_families.scaler.model import ScalerArm
from plants.blind_families.sensing import Roughness, draw_roughness, stamps
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.motions import CircleWithHeight, references
from residual_mpc.blind.levels import Level

Array = NDArray[np.float64]
_SPEED_NOISE = 0.01  # rad/s, of logged joint speeds
_SPIN_UP = 0.7  # s, reference held at its start
_WITHIN = 0.7  # share of the serial arms' motions that keeps links a and f inside their limits
_RATE = 100.0  # Hz, the paper's


def draw_setting(level: Level, rng: np.random.Generator) -> Setting | None:
    """Everything of a case that is no effect; None where the arm runs away."""
    arm, n = ScalerArm(), len(MOTORS)
    rough = draw_roughness(rng) if level.rough else Roughness()
    motion = _motion(arm, level, rough, rng)
    sigma = np.full(n, float(rng.uniform(4e-4, 8e-4))) * level.noise
    nothing = ArmSensor(np.zeros(n), np.zeros(n), np.zeros(n))
    happened = play(ideal(arm), motion)
    if happened is None:
        return None
    speed = happened.speed(motion.t, nothing)
    robot = ArmRobot(
        ideal(arm),
        nothing,
        np.quantile(np.abs(happened.torque), 0.995, axis=(0, 1)),
        np.sqrt((happened.torque**2).mean(axis=(0, 1))),
        np.sqrt((speed**2).mean(axis=(0, 1))),
        inertia_at_home(arm),
        np.abs(happened.command).max(axis=(0, 1)),
        motion.reference.max(axis=(0, 1)),
        motion.reference.min(axis=(0, 1)),
    )
    resolution = 2 * np.pi / float(rng.choice([4096, 16384]))
    table = str(rng.choice(["csv", "parquet"]))
    velocities = bool(rng.random() < 0.5)
    return Setting(robot, motion, sigma, resolution, rough, velocities, _SPEED_NOISE, False, table)


def inertia_at_home(arm: ScalerArm) -> Array:
    """Diagonal (6,) kg m^2 of the inertia that the motors see, the rods of the loop left out."""
    rigid = arm.rigid(ideal(arm))
    data = mujoco.MjData(rigid.model)
    data.qpos[rigid.motors] = arm.home
    rigid.close(data.qpos[None], data.qvel[None])
    mujoco.mj_forward(rigid.model, data)
    full = np.zeros((rigid.model.nv, rigid.model.nv))
    mujoco.mj_fullM(rigid.model, data, full)
    return np.array(np.diag(full)[rigid.motors])


def _motion(arm: ScalerArm, level: Level, rough: Roughness, rng: np.random.Generator) -> ReferenceMotion:
    """Three motions of the serial arms, made smaller, and the paper's circle that rises and falls."""
    t = np.unique(np.round(stamps(float(rng.uniform(9, 12)), _RATE, rough, rng) / STEP)) * STEP
    kinds: list[motions.Motion] = [motions.multisine, motions.steps, motions.sweep]
    if level.rough:
        kinds = [motions.working_day, motions.working_day, motions.sweep]
    since = np.maximum(t - _SPIN_UP, 0.0)
    drawn = [arm.home + _WITHIN * kind(since, len(MOTORS), rng) for kind in kinds]
    circle = CircleWithHeight(float(rng.uniform(0.03, 0.045)), float(rng.uniform(3.0, 6.0)))
    reference = np.stack([*drawn, references(circle, since, arm.arm)])
    return ReferenceMotion(t, reference, np.ones_like(reference), 0.8 if level.rough else 0.0)
