"""The batched replay: one simulation a row, the effects written into the batch before and between its steps."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.edits import edit_batch
from residual_mpc.effects.actuator import sag_step
from residual_mpc.effects.body import coulomb_level, load_level, stribeck_level
from residual_mpc.effects.chain import command_chain
from residual_mpc.effects.command import dead_zone_step
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

if TYPE_CHECKING:
    from plants.mujoco_robot.robot import MujocoRobot

FRICTIONS = ("coulomb_friction", "stribeck_friction", "load_dependent_friction")
# MuJoCo's dry friction is a soft constraint that creeps while it sticks; where an effect adds friction it is made stiff
STIFF_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)


def replay(
    robot: "MujocoRobot", start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
) -> Mapping[str, np.ndarray]:
    """See Robot.replay. A row whose simulation diverges holds NaN from then on."""
    from mujoco.batch import Batch

    model, effects = robot.model, settings.effects
    rows, steps = settings.rows, drive.steps
    batch = Batch(model, rows)
    edit_batch(batch, model, settings, robot.payload)
    batch.reset()
    q, v, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    qadr, vadr = model.jnt_qposadr, model.jnt_dofadr
    for j, joint in enumerate(robot.joints):
        q[:, qadr[j]] = start[f"position.{joint}"]
        v[:, vadr[j]] = start[f"velocity.{joint}"]
    servo = np.array([kind == "position" for kind in robot.command_kinds])
    u = command_chain(effects, drive.command, drive.lead, drive.dt, ~servo)
    drives = model.actuator_trnid[:, 0]  # (nu,) the joint that each actuator drives
    if model.na:  # an actuator with a filter starts where its first command holds it
        batch.bind("act")[:] = u[:, 0, model.actuator_actadr >= 0]

    between = _between_steps(batch, robot, settings, drive)
    needs_force = any(c.startswith("output.") for c in wanted) or "load_dependent_friction" in effects
    force = batch.bind("actuator_force") if needs_force else np.zeros((rows, model.nu))
    record = _Recorder(robot, wanted, rows, steps)
    zone = effects.get("dead_zone")
    width = None if zone is None or not servo.any() else np.where(servo, zone["width"], 0.0)
    gear = model.actuator_gear[:, 0]
    for k in range(steps):
        record.state(k, q, v)
        ctrl[:] = u[:, k]
        if width is not None:
            length = gear * q[:, qadr[drives]]
            error, _ = dead_zone_step(NUMPY, {"width": width}, (), u[:, k] - length, drive.dt)
            ctrl[:] = np.where(error == u[:, k] - length, u[:, k], length + error)
        for update in between:
            update(k, v[:, vadr], force)
        batch.step()
        record.force(k, force)
    record.state(steps, q, v)
    return record.result()


def _between_steps(batch: Any, robot: "MujocoRobot", settings: Settings, drive: Drive) -> list[Any]:
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
    written into gainprm, biasprm and forcerange, so that MuJoCo's implicit integrator still sees the servo's damping."""
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
    constant = np.ones((settings.rows, model.nu)) if gain is None else gain

    def write(scale: np.ndarray) -> None:
        gainprm[:, :, :3] = base[0] * scale[:, :, None]
        biasprm[:, :, :3] = base[1] * scale[:, :, None]
        reach = base[2] * scale[:, :, None]
        forcerange[:] = reach if limit is None else np.clip(reach, -limit[:, :, None], limit[:, :, None])

    write(constant)
    if sag is None and enabled is None:
        return None

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        scale = constant
        if sag is not None:
            scale, _ = sag_step(NUMPY, sag, (), scale, (drive.clock + (k + 0.5) * drive.dt)[:, None], drive.dt)
        if enabled is not None:
            if sag is None and k and np.array_equal(enabled[:, k], enabled[:, k - 1]):
                return
            scale = scale * enabled[:, k]
        write(scale)

    return update


def _friction(batch: Any, robot: "MujocoRobot", settings: Settings) -> Any:
    """The dry frictions' levels as dof_frictionloss: MuJoCo's solver supplies the sign, sticking included."""
    effects = settings.effects
    present = [e for e in FRICTIONS if e in effects]
    if not present:
        return None
    model = robot.model
    dof = model.jnt_dofadr
    loss = batch.expand("dof_frictionloss")
    base = loss[:, dof].copy()
    touched = np.zeros(base.shape, dtype=bool)
    for e in present:
        for p, values in effects[e].items():
            if p != "velocity":
                touched |= values != 0
    solimp = batch.expand("dof_solimp")
    index = np.argwhere(touched)
    solimp[index[:, 0], dof[index[:, 1]]] = STIFF_SOLIMP
    constant = base + (coulomb_level(NUMPY, effects["coulomb_friction"], base, base) if "coulomb_friction" in effects else 0.0)
    loss[:, dof] = np.maximum(constant, 0.0)
    if present == ["coulomb_friction"]:
        return None
    drives, gear = model.actuator_trnid[:, 0], model.actuator_gear[:, 0]

    def update(k: int, speed: np.ndarray, force: np.ndarray) -> None:
        level = constant
        if "stribeck_friction" in effects:
            level = level + stribeck_level(NUMPY, effects["stribeck_friction"], speed, speed)
        if "load_dependent_friction" in effects:
            torque = np.zeros_like(speed)
            np.add.at(torque, (slice(None), drives), gear * force)
            level = level + load_level(NUMPY, effects["load_dependent_friction"], speed, torque)
        loss[:, dof] = np.maximum(level, 0.0)

    return update


class _Recorder:
    """Collects the wanted channels node by node."""

    def __init__(self, robot: "MujocoRobot", wanted: tuple[str, ...], rows: int, steps: int) -> None:
        self._wanted = wanted
        self._kinds = [c.split(".", 1) for c in wanted]
        model = robot.model
        names = {"position": robot.joints, "velocity": robot.joints, "output": robot.actuators}
        place = {"position": model.jnt_qposadr, "velocity": model.jnt_dofadr, "output": np.arange(model.nu)}
        self._columns = {
            kind: [(i, int(place[kind][names[kind].index(name)])) for i, (k, name) in enumerate(self._kinds) if k == kind]
            for kind in names
        }
        self._out = np.empty((steps + 1, len(wanted), rows))

    def state(self, k: int, q: np.ndarray, v: np.ndarray) -> None:
        for i, column in self._columns["position"]:
            self._out[k, i] = q[:, column]
        for i, column in self._columns["velocity"]:
            self._out[k, i] = v[:, column]

    def force(self, k: int, force: np.ndarray) -> None:
        for i, column in self._columns["output"]:
            self._out[k : k + 2, i] = force[:, column]

    def result(self) -> dict[str, np.ndarray]:
        return {c: self._out[:, i].T for i, c in enumerate(self._wanted)}
