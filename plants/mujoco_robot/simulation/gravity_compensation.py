"""Torques of a controller that bear the weight of the modelled robot (PD control with gravity compensation: Siciliano
et al., Robotics: Modelling, Planning and Control, 2009, section 8.5.1).

The effect adds its share to the motors' torques. A model may have `gravcomp` instead, an upward force at the centre of
mass of each body (MuJoCo, XML reference). In MuJoCo this force grows with the body's mass and follows its centre. The
force of a controller does not, since the controller knows of no payload, mass, length or tilt that the model lacks. In
rows that have such an effect, `gravcomp` therefore supports the weight of the model as its file states it.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from residual_mpc.effects.effect import Quantity
from residual_mpc.effects.library import changes, present
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

UNKNOWN: tuple[Quantity, ...] = (
    "link mass", "link centre", "tool mass", "link length", "gravity roll", "gravity pitch"
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Compensation:
    """share (B, 1): of the gravity torques, or of the weight that `gravcomp` supports if the model has it; nominal: a
    batch of the model as its file states it, whatever payload, masses, lengths or tilt the rows have."""

    robot: CompiledRobot
    share: np.ndarray
    nominal: Any

    @property
    def of_model(self) -> bool:
        """Whether the model itself has `gravcomp`, a separate force that also acts without motors."""
        return bool(self.robot.model.body_gravcomp.any())

    def torques(self, q: np.ndarray) -> np.ndarray:
        """(B, nv) N m at positions q (B, nq): share g(q), with g(q) the bias force at rest (MuJoCo, Computation,
        general framework), 0 at joints without a motor; or the share of what `gravcomp` adds."""
        import mujoco

        gears, place = self.robot.gears, self.nominal.bind("qpos")
        weight = self.nominal.bind("qfrc_gravcomp" if self.of_model else "qfrc_bias")  # bound later, it stays empty
        place[:] = q
        if gears is not None and self.robot.servo_feedback == "motor":
            place[:, gears.places] = 0.0
        self.nominal.forward(stage=int(mujoco.mjtStage.mjSTAGE_VEL))
        if self.of_model:
            return np.asarray(self.share * weight)
        out = np.zeros((len(q), self.robot.model.nv))
        dofs = self.robot.dofs[np.unique(self.robot.driven)]
        out[:, dofs] = self.share * weight[:, dofs]
        return out


def unknown_weight(robot: CompiledRobot, settings: Settings) -> np.ndarray:
    """(B,) bool: rows with a mass, a length or a tilt that the model's `gravcomp` does not take into account."""
    rows = np.zeros(settings.rows, dtype=bool)
    model = robot.model
    if not model.body_gravcomp.any() or model.jnt_actgravcomp.any():  # as an actuator torque, it is limited
        return rows
    for quantity in UNKNOWN:
        change = changes(settings.effects, quantity)
        if change is not None:
            rows |= (change != 0.0).any(axis=1)
    return rows


def compensation_of(robot: CompiledRobot, settings: Settings, setting: np.ndarray | None) -> Compensation | None:
    """The compensation in addition to MuJoCo's own `gravcomp`, by row; None without any.

    setting (B,): the index of each row's settings."""
    import mujoco
    from mujoco.batch import Batch

    unknown = unknown_weight(robot, settings)
    share = unknown[:, None].astype(float) if unknown.any() else changes(settings.effects, "compensated gravity")
    if share is None or not np.any(share):
        return None
    model, off = copy(robot.model), mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONTACT) | int(off.mjDSBL_CONSTRAINT)
    nominal = Batch(model, settings.rows, nthread=1)
    if robot.differing and setting is not None:
        for field in robot.differing:
            nominal.expand(field)[:] = np.stack([getattr(r.model, field) for r in robot.settings])[setting]
    nominal.reset()
    nominal.bind("qvel")[:] = 0.0
    return Compensation(robot, np.asarray(share), nominal)


def compensating(
    batch: Any, robot: CompiledRobot, settings: Settings, drive: Drive
) -> Callable[[int, np.ndarray, np.ndarray], None] | None:
    """(step, joint speeds, force) -> None: adds to the torques of laws, which were written before; None without any
    compensation. A motor that is off adds nothing."""
    compensation = compensation_of(robot, settings, drive.setting)
    if compensation is None:
        return None
    if compensation.of_model:
        batch.expand("body_gravcomp")[compensation.share[:, 0] > 0.0] = 0.0
    q, applied = batch.bind("qpos"), batch.bind("qfrc_applied")
    ruled, dofs = bool(any(present(settings.effects, "law"))), robot.dofs[robot.driven]

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        torque = compensation.torques(q)
        if drive.enabled is not None and not compensation.of_model:
            on = np.zeros_like(torque)
            for i, dof in enumerate(dofs.tolist()):
                on[:, dof] = np.maximum(on[:, dof], drive.enabled[:, k, i])
            torque *= on
        applied[:] = applied + torque if ruled else torque

    return update
