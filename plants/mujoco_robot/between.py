"""What is rewritten in a batch between its steps: actuators that weaken or are switched off, frictions that change."""

from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.gears import link_servos
from residual_mpc.effects.actuator import sag_step
from residual_mpc.effects.body import coulomb_level, load_level, stribeck_level
from residual_mpc.effects.library import PLUGGED
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.plugged import present
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings, is_null

if TYPE_CHECKING:
    from plants.mujoco_robot.robot import MujocoRobot

FRICTIONS = ("coulomb_friction", "stribeck_friction", "load_dependent_friction")
# MuJoCo's dry friction is a soft constraint that creeps while it sticks; where an effect adds friction it is made stiff
STIFF_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)


def changing(robot: "MujocoRobot", settings: Settings, wanted: tuple[str, ...]) -> np.ndarray:
    """(B,) bool: rows that need a word between the steps."""
    if any(c.startswith("output.") for c in wanted) or len(link_servos(robot)):
        return np.ones(settings.rows, dtype=bool)
    slow = np.zeros(settings.rows, dtype=bool)
    effects = settings.effects
    frictions = (e.name for e, _ in present(PLUGGED, effects, "friction"))
    for effect in ("voltage_sag", "stribeck_friction", "load_dependent_friction", *frictions):
        if effect in effects:
            slow |= ~is_null(effect, effects[effect]).all(axis=1)
    if "dead_zone" in effects and "position" in robot.command_kinds:
        slow |= ~is_null("dead_zone", effects["dead_zone"]).all(axis=1)
    return slow


def between_steps(batch: Any, robot: "MujocoRobot", settings: Settings, drive: Drive) -> list[Any]:
    """Functions (step, joint speeds (B, njnt), last actuator force (B, nu)) that rewrite the batch before a step."""
    updates = []
    actuators = _actuator_scale(batch, robot, settings, drive)
    if actuators is not None:
        updates.append(actuators)
    frictions = _friction(batch, robot, settings)
    if frictions is not None:
        updates.append(frictions)
    return updates


def _actuator_scale(batch: Any, robot: "MujocoRobot", settings: Settings, drive: Drive) -> Any:
    """Gain, sag and `enabled` scale an actuator's force, saturation limits it: gain_step, sag_step and saturation_step
    written into gainprm, biasprm and forcerange, so that MuJoCo's implicit integrator still sees the servo's
    damping.

    A range that the model gives the force is the driver's own: a softer servo reaches it later, a weak supply and a
    switched-off one lower it.
    """
    effects, model = settings.effects, robot.model
    sag, enabled = effects.get("voltage_sag"), drive.enabled
    gain = effects.get("actuator_gain", {}).get("gain")
    limit = effects.get("saturation", {}).get("limit")
    if gain is None and limit is None and sag is None and enabled is None:
        return None
    gainprm, biasprm = batch.expand("actuator_gainprm"), batch.expand("actuator_biasprm")
    forcerange = batch.expand("actuator_forcerange")
    # after retuning: the batch's own values are the nominal ones of each row
    base = gainprm[:, :, :3].copy(), biasprm[:, :, :3].copy(), forcerange.copy()
    whole = np.ones((settings.rows, model.nu))

    def write(strength: np.ndarray) -> None:
        law = strength if gain is None else gain * strength
        gainprm[:, :, :3] = base[0] * law[:, :, None]
        biasprm[:, :, :3] = base[1] * law[:, :, None]
        reach = base[2] * strength[:, :, None]
        forcerange[:] = reach if limit is None else np.clip(reach, -limit[:, :, None], limit[:, :, None])

    write(whole)
    if sag is None and enabled is None:
        return None

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        strength = whole
        if sag is not None:
            strength, _ = sag_step(NUMPY, sag, (), strength, (drive.clock + (k + 0.5) * drive.dt)[:, None], drive.dt)
        if enabled is not None:
            if sag is None and k and np.array_equal(enabled[:, k], enabled[:, k - 1]):
                return
            strength = strength * enabled[:, k]
        write(strength)

    return update


def _friction(batch: Any, robot: "MujocoRobot", settings: Settings) -> Any:
    """The dry frictions' levels as dof_frictionloss: MuJoCo's solver supplies the sign, sticking included."""
    effects = settings.effects
    yours = list(present(PLUGGED, effects, "friction"))
    named = [e for e in FRICTIONS if e in effects] + [e.name for e, _ in yours]
    if not named:
        return None
    model = robot.model
    dof = robot.dofs
    loss = batch.expand("dof_frictionloss")
    base = loss[:, dof].copy()
    touched = np.zeros(base.shape, dtype=bool)
    for e in named:
        touched |= ~is_null(e, effects[e])
    solimp = batch.expand("dof_solimp")
    index = np.argwhere(touched)
    solimp[index[:, 0], dof[index[:, 1]]] = STIFF_SOLIMP
    constant = base + (
        coulomb_level(NUMPY, effects["coulomb_friction"], base, base) if "coulomb_friction" in effects else 0.0
    )
    loss[:, dof] = np.maximum(constant, 0.0)
    if named == ["coulomb_friction"]:
        return None
    drives, gear = robot.driven, model.actuator_gear[:, 0]

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        level = constant
        if "stribeck_friction" in effects:
            level = level + stribeck_level(NUMPY, effects["stribeck_friction"], speed, speed)
        torque = np.zeros_like(speed)
        for i, joint in enumerate(drives):
            torque[:, joint] += gear[i] * force[:, i]
        if "load_dependent_friction" in effects:
            level = level + load_level(NUMPY, effects["load_dependent_friction"], speed, torque)
        for effect, p in yours:
            assert effect.step is not None
            level = level + effect.step(NUMPY, p, speed, torque)
        loss[:, dof] = np.maximum(level, 0.0)

    return update
