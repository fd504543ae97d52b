"""The batched replay: one simulation a row, the effects written into the batch before and between its steps."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.base import unwrapped
from plants.mujoco_robot.edits import edit_batch
from plants.mujoco_robot.gear_start import WARM, begin
from plants.mujoco_robot.gears import Feedback, by_gears, edit_gears, feedback, link_servos, on_link_side
from residual_mpc.effects.actuator import sag_step
from residual_mpc.effects.body import coulomb_level, load_level, stribeck_level
from residual_mpc.effects.chain import command_chain
from residual_mpc.effects.command import dead_zone_step
from residual_mpc.effects.library import PLUGGED
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.plugged import present
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings, is_null

if TYPE_CHECKING:
    from plants.mujoco_robot.robot import MujocoRobot

FEW = 600  # rows times degrees of freedom
FRICTIONS = ("coulomb_friction", "stribeck_friction", "load_dependent_friction")
# MuJoCo's dry friction is a soft constraint that creeps while it sticks; where an effect adds friction it is made stiff
STIFF_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)


def replay(
    robot: "MujocoRobot", start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
) -> Mapping[str, np.ndarray]:
    """See Robot.replay. A row whose simulation diverges repeats its last state.

    Rows whose actuators or frictions change from step to step are stepped one by one, the others rolled out at once:
    between two steps of a small model, Python costs more than MuJoCo.
    """
    parts = []
    for apart, rows in by_gears(robot, settings):
        slow = changing(apart, settings, wanted)[rows]
        parts += [(apart, some, stepped) for stepped in (True, False) if len(some := rows[slow == stepped])]
    if len(parts) == 1:
        return _replay(parts[0][0], start, drive, settings, wanted, parts[0][2])
    out = {c: np.empty((settings.rows, drive.steps + 1)) for c in wanted}
    for apart, rows, stepped in parts:
        part = Drive(
            drive.dt,
            drive.lead,
            drive.command[rows],
            None if drive.enabled is None else drive.enabled[rows],
            drive.clock[rows],
            None if drive.setting is None else drive.setting[rows],
        )
        found = _replay(apart, {k: v[rows] for k, v in start.items()}, part, settings.take(rows), wanted, stepped)
        for c in wanted:
            out[c][rows] = found[c]
    return out


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


def _replay(
    robot: "MujocoRobot",
    start: Mapping[str, np.ndarray],
    drive: Drive,
    settings: Settings,
    wanted: tuple[str, ...],
    stepped: bool,
) -> Mapping[str, np.ndarray]:
    from mujoco.batch import Batch

    model = robot.model
    # with few rows, waking a second thread at every step costs more than it brings
    batch = Batch(model, settings.rows, nthread=1 if settings.rows * model.nv < FEW else 0)
    if robot.differing and drive.setting is not None:
        for field in robot.differing:
            batch.expand(field)[:] = np.stack([getattr(r.model, field) for r in robot.settings])[drive.setting]
    edit_batch(batch, robot, settings)
    if robot.gears is not None:
        edit_gears(batch, robot, settings)
    batch.reset()
    q, v = batch.bind("qpos"), batch.bind("qvel")
    rolling = None if robot.base is None else robot.base.write(q, v, start)
    for j, joint in enumerate(robot.joints):
        if joint not in robot.passive:
            q[:, robot.places[j]] = start[f"position.{joint}"]
            v[:, robot.dofs[j]] = start[f"velocity.{joint}"]
    if rolling is not None:  # a speed that nobody measured starts as exactly 0: such a wheel rolls with the robot
        v[:, robot.dofs] = np.where(v[:, robot.dofs] == 0.0, rolling, v[:, robot.dofs])
    if robot.loops is not None:
        robot.loops.close(q, v)
    servo = np.array([kind == "position" for kind in robot.command_kinds])
    warm = round(WARM / drive.dt) if robot.gears is not None else 0
    warm = warm if warm <= drive.lead else 0  # what is cut short would begin with a jolt of its own
    u = command_chain(settings.effects, drive.command, drive.lead - warm, drive.dt, ~servo)
    before, u = u, u[:, warm:]
    if model.na:  # an actuator with a filter starts where its first command holds it
        batch.bind("act")[:] = u[:, 0, model.actuator_actadr >= 0]
    servos = feedback(batch, robot)
    between = between_steps(batch, robot, settings, drive)
    if robot.gears is not None:
        for update in between:
            update(0, v[:, robot.dofs], np.zeros((settings.rows, model.nu)))
        begin(batch, robot, settings, before, warm, servos)
        if model.na:
            batch.bind("act")[:] = u[:, 0, model.actuator_actadr >= 0]
    if stepped:
        out = _step_by_step(batch, robot, settings, drive, u, between, wanted, servos)
    else:
        out = _roll_out(batch, robot, drive, u, between, wanted)
    if "pose.theta" in out:
        out["pose.theta"] = unwrapped(out["pose.theta"], start["pose.theta"])
    for channel, nodes in out.items():
        kind = channel.split(".")[0]
        if kind in ("pose", "twist") or (robot.gears is not None and kind in ("position", "velocity")):
            nodes[:, 0] = start[channel]  # what went through a quaternion or a sum comes back to the last digit but one
    return out


def _roll_out(
    batch: Any, robot: "MujocoRobot", drive: Drive, u: np.ndarray, between: list[Any], wanted: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """All steps in one call, or in a few where actuators are switched on and off on the way."""
    import mujoco

    model, (rows, steps, _) = robot.model, u.shape
    cuts = [0]
    if drive.enabled is not None:
        cuts += (1 + np.flatnonzero((np.diff(drive.enabled, axis=1) != 0).any(axis=(0, 2)))).tolist()
    control = int(mujoco.mjtState.mjSTATE_CTRL)
    finer = 1 if robot.gears is None else robot.gears.substeps
    parts = {"qpos": [batch.bind("qpos")[:, None].copy()], "qvel": [batch.bind("qvel")[:, None].copy()]}
    for k, end in zip(cuts, [*cuts[1:], steps], strict=True):
        for update in between:
            update(k, batch.bind("qvel")[:, robot.dofs], np.zeros((rows, model.nu)))
        held = np.ascontiguousarray(u[:, k:end]) if finer == 1 else np.repeat(u[:, k:end], finer, axis=1)
        found = batch.rollout(finer * (end - k), held, control, ("qpos", "qvel"))
        for field, part in parts.items():
            part.append(found[field][:, finer - 1 :: finer])
    whole = {field: np.concatenate(part, axis=1) for field, part in parts.items()}
    on_link_side(robot, whole)
    out = {}
    for channel in wanted:
        kind, name = channel.split(".", 1)
        if robot.base is not None and kind in ("pose", "twist"):
            out[channel] = robot.base.read(channel, whole["qpos"], whole["qvel"])
            continue
        j = robot.joints.index(name)
        field, column = ("qpos", robot.places[j]) if kind == "position" else ("qvel", robot.dofs[j])
        out[channel] = whole[field][:, :, column]
    return out


def _step_by_step(
    batch: Any,
    robot: "MujocoRobot",
    settings: Settings,
    drive: Drive,
    u: np.ndarray,
    between: list[Any],
    wanted: tuple[str, ...],
    servos: Feedback | None,
) -> dict[str, np.ndarray]:
    model, effects = robot.model, settings.effects
    rows, steps = settings.rows, drive.steps
    q, v, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    loaded = "load_dependent_friction" in effects or any(True for _ in present(PLUGGED, effects, "friction"))
    needs_force = any(c.startswith("output.") for c in wanted) or loaded
    force = batch.bind("actuator_force") if needs_force else np.zeros((rows, model.nu))
    record = _Recorder(robot, wanted, rows, steps)
    servo = np.array([kind == "position" for kind in robot.command_kinds])
    zone = effects.get("dead_zone")
    width = None if zone is None or not servo.any() else np.where(servo, zone["width"], 0.0)
    gear, driven = model.actuator_gear[:, 0], robot.places[robot.driven]
    finer = 1 if robot.gears is None else robot.gears.substeps
    for k in range(steps):
        record.state(k, q, v)
        ctrl[:] = u[:, k]
        if width is not None:
            length = gear * (q[:, driven] if servos is None else servos.seen(robot, q))
            error, _ = dead_zone_step(NUMPY, {"width": width}, (), u[:, k] - length, drive.dt)
            ctrl[:] = np.where(error == u[:, k] - length, u[:, k], length + error)
        for update in between:
            update(k, v[:, robot.dofs], force)
        if servos is not None:
            servos.correct(ctrl, robot, q, v)
        batch.step(nstep=finer)
        record.force(k, force)
    record.state(steps, q, v)
    return record.result()


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


class _Recorder:
    """Collects the wanted channels node by node."""

    def __init__(self, robot: "MujocoRobot", wanted: tuple[str, ...], rows: int, steps: int) -> None:
        self._wanted = wanted
        self._kinds = [c.split(".", 1) for c in wanted]
        self._base = robot.base
        self._poses = [(i, c) for i, c in enumerate(wanted) if c.split(".")[0] in ("pose", "twist")]
        names = {"position": robot.joints, "velocity": robot.joints, "output": robot.actuators}
        place = {"position": robot.places, "velocity": robot.dofs, "output": np.arange(robot.model.nu)}
        self._columns = {
            kind: [
                (i, int(place[kind][names[kind].index(name)])) for i, (k, name) in enumerate(self._kinds) if k == kind
            ]
            for kind in names
        }
        self._out = np.empty((steps + 1, len(wanted), rows))
        self._robot = robot

    def state(self, k: int, q: np.ndarray, v: np.ndarray) -> None:
        if self._robot.gears is not None:
            q, v = q.copy(), v.copy()
            on_link_side(self._robot, {"qpos": q, "qvel": v})
        for i, column in self._columns["position"]:
            self._out[k, i] = q[:, column]
        for i, column in self._columns["velocity"]:
            self._out[k, i] = v[:, column]
        if self._base is not None:
            for i, channel in self._poses:
                self._out[k, i] = self._base.read(channel, q, v)

    def force(self, k: int, force: np.ndarray) -> None:
        for i, column in self._columns["output"]:
            self._out[k : k + 2, i] = force[:, column]

    def result(self) -> dict[str, np.ndarray]:
        return {c: self._out[:, i].T for i, c in enumerate(self._wanted)}
