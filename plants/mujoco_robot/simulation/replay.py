"""The batched replay: one simulation a row, the effects written into the batch before and between its steps."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from plants.mujoco_log import silence_mujoco
from plants.mujoco_robot.edits.batch import edit_batch
from plants.mujoco_robot.edits.split_gears import by_gears, edit_gears
from plants.mujoco_robot.native.arms import native_arm
from plants.mujoco_robot.simulation.between import between_steps, changing
from plants.mujoco_robot.simulation.channels import read_channels, write_start
from plants.mujoco_robot.simulation.compiled_steps import FORCES, RESISTANCES, Fields, copied, replay_natively
from plants.mujoco_robot.simulation.gear_feedback import Feedback, feedback
from plants.mujoco_robot.simulation.gear_start import WARM, begin
from plants.mujoco_robot.simulation.one_step import OneStep
from plants.mujoco_robot.simulation.servo_integral import ServoIntegrals, begin_integrals
from plants.mujoco_robot.simulation.warp_batch import batch_of
from plants.mujoco_robot.structure.base import unwrapped
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_timers import stop_mujoco_timers
from residual_mpc.effects.chain import command_chain, on_errors
from residual_mpc.effects.library import present
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings

FAR_AWAY = 1e10  # m, rad, m/s, rad/s: MuJoCo's own limit, mjMAXVAL
NO_STAGE = 0  # mjSTAGE_NONE: a step computes all that it needs
WORTH_A_THREAD = 24  # rows times degrees of freedom: with fewer, waking it at every step costs more than it brings


def replay(
    robot: CompiledRobot, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
) -> Mapping[str, np.ndarray]:
    """See Robot.replay. A row whose simulation diverges repeats its last state.

    Rows whose actuators or frictions change from step to step are stepped one by one, the others rolled out at once:
    between two steps of a small model, Python costs more than MuJoCo.
    """
    parts = []
    for apart, rows in by_gears(robot.own or robot, settings):
        apart = robot if apart is robot.own else apart
        slow = changing(apart, settings, wanted)[rows]
        parts += [(apart, some, stepped) for stepped in (True, False) if len(some := rows[slow == stepped])]
    if len(parts) == 1:
        return _on_own_steps(robot, parts[0][0], start, drive, settings, wanted, parts[0][2])
    out = {c: np.empty((settings.rows, drive.steps + 1)) for c in wanted}
    for apart, rows, stepped in parts:
        part = replace(
            drive,
            command=drive.command[rows],
            enabled=None if drive.enabled is None else drive.enabled[rows],
            clock=drive.clock[rows],
            setting=None if drive.setting is None else drive.setting[rows],
            enabled_before=None,
            past=None if drive.past is None else drive.past.take(rows),
        )
        begun = {k: v[rows] for k, v in start.items()}
        found = _on_own_steps(robot, apart, begun, part, settings.take(rows).acting(), wanted, stepped)
        for c in wanted:
            out[c][rows] = found[c]
    return out


def _on_own_steps(
    robot: CompiledRobot,
    apart: CompiledRobot,
    start: Mapping[str, np.ndarray],
    drive: Drive,
    settings: Settings,
    wanted: tuple[str, ...],
    stepped: bool,
) -> Mapping[str, np.ndarray]:
    """The replay of rows whose robot is `apart`. Where the robot has a longer step, split gears keep the model file's:
    their stops and springs are stiff."""
    times = robot.longer
    if times == 1 or apart.gears is None:
        return _replay(apart, start, drive, settings, wanted, stepped)
    fine = replace(
        drive,
        dt=drive.dt / times,
        lead=drive.lead * times,
        command=np.repeat(drive.command, times, axis=1),
        enabled=None if drive.enabled is None else np.repeat(drive.enabled, times, axis=1),
        enabled_before=None,
    )
    return {c: y[:, ::times] for c, y in _replay(apart, start, fine, settings, wanted, stepped).items()}


def threads_for(size: int) -> int:
    """Threads of a batch of that many rows times degrees of freedom."""
    return max(1, min(_cores(), size // WORTH_A_THREAD))


@cache
def _cores() -> int:
    """joblib's count, which heeds affinity, a container's quota and LOKY_MAX_CPU_COUNT."""
    from joblib import cpu_count

    return int(cpu_count())


def _replay(
    robot: CompiledRobot,
    start: Mapping[str, np.ndarray],
    drive: Drive,
    settings: Settings,
    wanted: tuple[str, ...],
    stepped: bool,
) -> Mapping[str, np.ndarray]:
    silence_mujoco()
    stop_mujoco_timers()
    model = robot.model
    batch = batch_of(model, settings.rows, threads_for(settings.rows * model.nv))
    if robot.differing and drive.setting is not None:
        for field in robot.differing:
            batch.expand(field)[:] = np.stack([getattr(r.model, field) for r in robot.settings])[drive.setting]
    edit_batch(batch, robot, settings)
    if robot.gears is not None:
        edit_gears(batch, robot, settings)
    batch.reset(stage=NO_STAGE)
    write_start(robot, batch.bind("qpos"), batch.bind("qvel"), start)
    warm = round(WARM / drive.dt) if robot.gears is not None and not drive.midway else 0
    warm = warm if warm <= drive.lead else 0  # what is cut short would begin with a jolt of its own
    u = command_chain(settings.effects, drive.command, drive.lead - warm, drive.dt, ~robot.servo)
    before, u = u, u[:, warm:]
    if model.na:  # an actuator with a filter starts where its first command holds it
        batch.bind("act")[:] = u[:, 0, model.actuator_actadr >= 0]
    servos = feedback(batch, robot)
    base = copied(batch, FORCES) if stepped else {}
    between = between_steps(batch, robot, settings, drive)
    base |= copied(batch, RESISTANCES) if stepped else {}
    integral = any(True for _ in present(settings.effects, "servo"))
    if robot.gears is not None or integral:
        for update in between:
            update(0, batch.bind("qvel")[:, robot.dofs], np.zeros((settings.rows, model.nu)))
    integrals = begin_integrals(batch, robot, settings, drive, u[:, 0] if drive.steps else None) if integral else None
    if robot.gears is not None:
        before = before if integrals is None else before + integrals.value[:, None]
        begin(batch, robot, settings, before, warm, servos)
        if model.na:
            batch.bind("act")[:] = u[:, 0, model.actuator_actadr >= 0]
    if stepped:
        out = _changing(batch, robot, drive, settings, u, base, between, integrals, servos, wanted)
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
    batch: Any, robot: CompiledRobot, drive: Drive, u: np.ndarray, between: list[Any], wanted: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """All steps in one call, or in a few where actuators are switched on and off on the way."""
    rows, nu = len(u), robot.model.nu
    cuts = [0]
    if drive.enabled is not None:
        cuts += (1 + np.flatnonzero((np.diff(drive.enabled, axis=1) != 0).any(axis=(0, 2)))).tolist()

    def rewrite(k: int) -> None:
        for update in between:
            update(k, batch.bind("qvel")[:, robot.dofs], np.zeros((rows, nu)))

    native = native_arm(robot)
    rolled = None if native is None else native.rollout(batch, u, cuts, robot.substeps, rewrite)
    if rolled is None:
        q, v = _by_mujoco(batch, u, cuts, robot.substeps, rewrite, np.arange(rows))
    else:
        q, v = rolled.positions, rolled.velocities
        left = np.flatnonzero(~rolled.exact)
        if len(left):
            q[left], v[left] = _by_mujoco(batch, u[left], cuts, robot.substeps, rewrite, left)
    _stay(q, v)
    return read_channels(robot, q, v, wanted)


def _by_mujoco(
    batch: Any, u: np.ndarray, cuts: list[int], finer: int, rewrite: Callable[[int], None], rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m, K + 1, nq) and velocities (m, K + 1, nv) of some rows (m,), under commands u (m, K, nu)."""
    import mujoco

    control = int(mujoco.mjtState.mjSTATE_CTRL)
    parts = {field: [batch.bind(field)[rows, None]] for field in ("qpos", "qvel")}
    for k, end in zip(cuts, [*cuts[1:], u.shape[1]], strict=True):
        rewrite(k)
        held = np.ascontiguousarray(u[:, k:end]) if finer == 1 else np.repeat(u[:, k:end], finer, axis=1)
        found = batch.rollout(finer * (end - k), held, control, ("qpos", "qvel"), rows)
        for field, part in parts.items():
            part.append(found[field][:, finer - 1 :: finer])
    q, v = (np.concatenate(part, axis=1) for part in parts.values())
    return q, v


def _changing(
    batch: Any,
    robot: CompiledRobot,
    drive: Drive,
    settings: Settings,
    u: np.ndarray,
    base: Fields,
    between: list[Any],
    integrals: ServoIntegrals | None,
    servos: Feedback | None,
    wanted: tuple[str, ...],
) -> dict[str, np.ndarray]:
    """Rows in which something changes from step to step."""
    records = any(c.startswith("output.") for c in wanted)
    rolled = replay_natively(batch, robot, settings, drive, u, base, integrals, servos, records)
    stepped: dict[str, np.ndarray] = {}
    if rolled is None or not rolled.exact.all():
        left = None if rolled is None else np.flatnonzero(~rolled.exact)
        errors = on_errors(settings.effects, robot.servo)
        step = OneStep(batch, robot, between, servos, errors, drive.dt, integrals, left)
        stepped = _step_by_step(step, u, wanted)
    if rolled is None:
        return stepped
    q, v, forces = rolled.positions, rolled.velocities, rolled.forces
    _stay(q, v, *((forces,) if records else ()))
    outputs = {c: forces[:, :, i] for i, a in enumerate(robot.actuators) if (c := f"output.{a}") in wanted}
    out = outputs | read_channels(robot, q, v, [c for c in wanted if c not in outputs])
    for channel, nodes in stepped.items():
        out[channel] = np.where(rolled.exact[:, None], out[channel], nodes)
    return out


def _step_by_step(step: OneStep, u: np.ndarray, wanted: tuple[str, ...]) -> dict[str, np.ndarray]:
    """One call a step; an actuator's output is the force in the step from its node on."""
    batch, robot, (rows, steps, nu) = step.batch, step.robot, u.shape
    q, v, force = batch.bind("qpos"), batch.bind("qvel"), batch.bind("actuator_force")
    whole_q, whole_v = (np.empty((rows, steps + 1, x.shape[1])) for x in (q, v))
    forces = np.empty((rows, steps + 1, nu))
    for k in range(steps):
        whole_q[:, k], whole_v[:, k] = q, v
        step(k, u[:, k], force)
        forces[:, k : k + 2] = force[:, None]
    whole_q[:, steps], whole_v[:, steps] = q, v
    _stay(whole_q, whole_v, forces)
    outputs = {c: forces[:, :, i] for i, a in enumerate(robot.actuators) if (c := f"output.{a}") in wanted}
    return outputs | read_channels(robot, whole_q, whole_v, [c for c in wanted if c not in outputs])


def _stay(q: np.ndarray, v: np.ndarray, *others: np.ndarray) -> None:
    """Let rows whose positions (B, K + 1, nq) or velocities (B, K + 1, nv) run away stay where they were last, in
    place; others (B, K + 1, n) likewise."""
    if all(-FAR_AWAY < x.min() and x.max() < FAR_AWAY for x in (q, v) if x.size):  # NaN is not
        return
    sane = (np.abs(q) < FAR_AWAY).all(axis=2) & (np.abs(v) < FAR_AWAY).all(axis=2)  # NaN is not
    sane[:, 0] = True
    for row in np.flatnonzero(~sane.all(axis=1)):
        end = int(np.argmin(sane[row]))
        for x in (q, v, *others):
            x[row, end:] = x[row, end - 1]
