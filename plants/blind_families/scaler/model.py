"""The SCALER arm as a truth knows it; its user has the model `scaler_arm`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm.truth import STEP, ArmTruth, Rigid
from plants.scaler_arm.engines.mjcf import TIMESTEP, Options, mjcf
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS, PASSIVE, SCALER, Arm
from plants.scaler_arm.robot import FiveBarLoop

Array = NDArray[np.float64]
# by motor, the link that it carries; links a and f end in b and e, of which e alone weighs something
CARRIED = ("shoulder", "a", "e", "wrist1", "wrist2", "gripper")
FOREARM = 2  # index of e among them
# The model's time step, implicit in the damping, lets its servo settle half a step sooner than the same spring and
# damper would; a robot without a gap is one that the model describes as it is stepped, so that the truth's damper is
# the smaller one that settles as soon.
_SOONER = 0.5 * (TIMESTEP - STEP)  # s


@dataclass(frozen=True)
class ScalerArm:
    """See ``arm.truth.NominalArm``; arm: as `scaler_arm` has it."""

    arm: Arm = SCALER

    @property
    def joints(self) -> tuple[str, ...]:
        return MOTORS

    @property
    def kind(self) -> str:
        return "position"

    @property
    def home(self) -> Array:
        return np.array(HOME)

    @property
    def length(self) -> Array:
        """m, from each carried link's joint to the next one; the gripper's is that of its tool point"""
        ends = {"shoulder": "f", "a": "b", "e": "wrist1", "wrist1": "wrist2", "wrist2": "wrist3"}
        to = [self.arm.joint(ends[link]).frame.xyz if link in ends else self.arm.tool for link in CARRIED]
        return np.linalg.norm(to, axis=1)

    @property
    def mass(self) -> Array:
        """kg, of the carried links; the gripper's holds wrist3's"""
        bodies = [self.arm.gripper_body if link == "gripper" else self.arm.joint(link).body for link in CARRIED]
        rest = np.zeros(len(MOTORS))
        rest[-1] = self.arm.joint("wrist3").body.mass
        return np.array([body.mass for body in bodies]) + rest

    @property
    def armature(self) -> Array:
        return np.full(len(MOTORS), self.arm.servo.armature)

    @property
    def kp(self) -> Array:
        return np.full(len(MOTORS), self.arm.servo.stiffness)

    @property
    def kv(self) -> Array:
        return np.full(len(MOTORS), self.arm.servo.damping) - self.kp * _SOONER

    @property
    def stop(self) -> Array:
        return np.full(len(MOTORS), self.arm.servo.torque)

    def rigid(self, truth: ArmTruth) -> Rigid:
        """The loop held by the model's own constraint; a semi-implicit Euler step a quarter as long as the model's."""
        model = compiled(truth, self)
        names = MOTORS + PASSIVE
        places = tuple(int(model.joint(n).qposadr[0]) for n in names)  # every joint is a hinge: the same in velocities
        loop = FiveBarLoop(self.arm, places, places)
        return Rigid(model, np.array(places[: len(MOTORS)]), loop.close)

    def write_model(self, folder: Path) -> list[str]:
        """Nothing to write: the robot is built in."""
        return ['plant = "scaler_arm"']


def compiled(truth: ArmTruth, nominal: ScalerArm) -> mujoco.MjModel:
    """The bodies under a truth's masses and armatures, without actuators, at the fine step.

    Raises ValueError for a link mass elsewhere than at the forearm.
    """
    if np.delete(truth.link_mass, FOREARM).any() or np.delete(truth.link_com, FOREARM).any():
        raise ValueError(f"only link {CARRIED[FOREARM]} can have an added mass, got {truth.link_mass} kg")
    spec = mujoco.MjSpec.from_string(mjcf(nominal.arm, Options(timestep=STEP, motors=False)))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    for i, motor in enumerate(MOTORS):
        spec.joint(motor).armature = nominal.armature[i] + truth.armature[i]
    forearm = spec.body(CARRIED[FOREARM])
    forearm.ipos = forearm.ipos + np.array([truth.link_com[FOREARM], 0.0, 0.0])  # x runs to the next joint
    if truth.link_mass[FOREARM]:
        for side in (-0.02, 0.02):  # two lumps around the centre
            _lump(forearm, forearm.ipos + np.array([side, 0.0, 0.0]), 0.5 * truth.link_mass[FOREARM])
    if truth.payload:
        _lump(spec.body("gripper"), np.array(nominal.arm.tool), truth.payload)
    return spec.compile()


def _lump(body: mujoco.MjsBody, at: Array, mass: float) -> None:
    """A ball of mass kg fixed to the body at ``at`` (3,) m. A body of its own: the model states inertias outright, and
    such a body does not count its shapes."""
    ball = body.add_body(pos=at)
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=mass, contype=0, conaffinity=0)
