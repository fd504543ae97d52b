"""The diagnosed model as an MJCF: every effect that MuJoCo itself can hold, written into the model's specification."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plants.mujoco_robot.loading.compile import mark_simple, prepared
from plants.mujoco_robot.simulation.channels import write_start
from plants.mujoco_robot.simulation.constants import corrected_constants
from plants.mujoco_robot.simulation.gravcomp import why_no_gravcomp, write_gravcomp
from plants.mujoco_robot.simulation.replay import replay
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from plants.mujoco_robot.structure.ranges import DEGREE
from residual_mpc.effects.body import COULOMB
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import BY_NAME, changes, present
from residual_mpc.effects.surroundings import GRAVITY_COMPENSATION
from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Drive
from residual_mpc.models.settings import Settings
from residual_mpc.models.simulating import Mjcf

if TYPE_CHECKING:
    import mujoco

SECONDS, DRIVES = 1.0, 4  # of the comparison with the replay


def to_mjcf(robot: CompiledRobot, settings: Settings, folder: Path) -> Mjcf:
    """See WritesMjcf. Raises BadInput for a robot that has no model file of its own or several settings, or where the
    effects change what an MJCF is not rewritten for here."""
    if robot.spec is None or robot.settings:
        why = "it has no model file of its own" if robot.spec is None else "its variants use several models"
        raise BadInput(
            f"{robot.name!r} cannot be exported as MJCF: {why}", "`to=mjcf`", "export each model file separately"
        )
    reasons = {e: not_held(BY_NAME[e]) for e in settings.effects}
    if GRAVITY_COMPENSATION.name in reasons:
        reasons[GRAVITY_COMPENSATION.name] = why_no_gravcomp(robot, settings)
    left_out = tuple(f"{e}: {why}" for e, why in reasons.items() if why)
    held = settled(Settings(1, {e: p for e, p in settings.effects.items() if not reasons[e]}, settings.tuned))
    spec, plain = robot.spec.copy(), robot.model
    write_numbers(spec, robot, held)
    write_gravcomp(spec, robot, held)
    write_memory(spec, held)
    spec.compile()
    if plain.nmesh or plain.ntex or plain.nhfield:  # seen from where the file will lie
        meshes = Path(spec.modelfiledir, spec.meshdir)
        spec.meshdir = spec.texturedir = os.path.relpath(meshes, folder)
    mark_simple(spec, True)
    text = spec.to_xml()
    spec.meshdir, spec.texturedir = robot.spec.meshdir, robot.spec.texturedir
    (some, whole), points = apart(robot, (held, settings), spec)
    notes = tuple(f"{e}: {BY_NAME[e].in_mjcf}" for e in settings.effects if BY_NAME[e].in_mjcf)
    return Mjcf(text, notes, left_out, some, whole, points)


def not_held(effect: Effect) -> str:
    """Why an MJCF does not hold the effect; empty where it does."""
    return "a user-defined effect cannot be expressed in MJCF" if effect.own else effect.not_in_mjcf


def settled(settings: Settings) -> Settings:
    """Friction that changes with the motion as the constant dry friction that comes nearest, beside what is dry
    already."""
    for effect, values in [(e, p) for e, p in present(settings.effects, "friction") if e.settled is not None]:
        assert effect.settled is not None
        level, rest = effect.settled(values), settings.without(effect.name)
        dry = rest.effects.get(COULOMB.name, {"torque": np.zeros_like(level)})
        settings = Settings(1, {**rest.effects, COULOMB.name: {"torque": dry["torque"] + level}}, rest.tuned)
    return settings


def write_numbers(spec: "mujoco.MjSpec", robot: CompiledRobot, settings: Settings) -> None:
    """The constants of one row of the diagnosis' batch, where they differ from the compiled model's."""
    model, changed = robot.model, corrected_constants(robot, settings)
    for j, joint in enumerate(robot.joints):
        dof = int(robot.dofs[j])
        at = spec.joint(joint)
        if "dof_damping" in changed:
            at.damping[0] = changed["dof_damping"][dof]
        if "dof_armature" in changed:
            at.armature = changed["dof_armature"][dof]
        if "dof_frictionloss" in changed:
            at.frictionloss = changed["dof_frictionloss"][dof]
        if "dof_solimp" in changed:
            at.solimp_friction = changed["dof_solimp"][dof]
        number, unit = int(robot.numbers[j]), 1.0 if joint in robot.sliding or not spec.compiler.degree else DEGREE
        if "jnt_stiffness" in changed:
            at.stiffness[0] = changed["jnt_stiffness"][number]
            at.springref = unit * changed.get("qpos_spring", model.qpos_spring)[robot.places[j]]
        if "jnt_limited" in changed or "jnt_range" in changed:
            at.limited = bool(changed.get("jnt_limited", model.jnt_limited)[number])
            at.range = unit * changed.get("jnt_range", model.jnt_range)[number]
    if "opt.gravity" in changed:
        spec.option.gravity = changed["opt.gravity"]
    for i, name in enumerate(robot.actuators):
        at = spec.actuator(name)
        for field in ("gainprm", "biasprm"):
            if f"actuator_{field}" in changed:
                getattr(at, field)[:] = changed[f"actuator_{field}"][i]
        reach = changed.get("actuator_forcerange", model.actuator_forcerange)[i]
        if np.abs(reach).max() < 0.5 * NO_LIMIT:
            at.forcelimited, at.forcerange = True, reach
    bodies = {body.id: body for body in spec.bodies}
    for b in range(1, model.nbody):
        at = bodies[b]
        if "body_pos" in changed:
            at.pos = changed["body_pos"][b]
        if any(f in changed for f in ("body_mass", "body_ipos", "body_inertia", "body_iquat")):
            at.explicitinertial = True
            at.fullinertia[:] = np.nan  # the axes are given
            for short in ("mass", "ipos", "inertia", "iquat"):
                value = changed.get(f"body_{short}", getattr(model, f"body_{short}"))[b]
                setattr(at, short, value)


def write_memory(spec: "mujoco.MjSpec", settings: Settings) -> None:
    """Delay and lag, which MuJoCo has of its own."""
    import mujoco

    effects, dt = settings.effects, spec.option.timestep
    found = (changes(effects, q) for q in ("command delay", "command lag"))
    delays, lags = (np.zeros(len(spec.actuators)) if x is None else x[0] for x in found)
    for actuator, delay, lag in zip(spec.actuators, delays.tolist(), lags.tolist(), strict=True):
        if delay > 0:
            actuator.delay, actuator.nsample, actuator.interp = delay, int(np.ceil(delay / dt)) + 2, 1  # linear
        if lag > 0:
            if actuator.dyntype != mujoco.mjtDyn.mjDYN_NONE:
                raise BadInput(
                    f"actuator {actuator.name!r} already has dynamics, so a lag cannot be added", "`to=mjcf`",
                    "use the built-in simulator",
                )  # fmt: skip
            actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            actuator.dynprm[0] = lag
            actuator.actearly = True


def apart(
    robot: CompiledRobot, hypotheses: tuple[Settings, ...], spec: "mujoco.MjSpec"
) -> tuple[tuple[float, ...], int]:
    """Largest difference of a joint between the written model and the replay of each hypothesis (one row), over drives
    about the model's home, and at how many samples; inf where one of the two diverges."""
    import mujoco

    model = prepared(spec.compile())
    steps, nu = round(SECONDS / robot.step), robot.model.nu
    t = robot.step * np.arange(steps)
    rng = np.random.default_rng(0)
    middle, size = _reach(robot)
    data = mujoco.MjData(model)
    mujoco.mj_resetData(model, data)
    home = {f"position.{j}": np.full(DRIVES, data.qpos[p]) for j, p in zip(robot.joints, robot.places, strict=True)}
    home |= {f"velocity.{j}": np.zeros(DRIVES) for j in robot.joints}
    if robot.base is not None:
        home |= {f"{k}.{a}": np.zeros(DRIVES) for k in ("pose", "twist") for a in ("x", "y", "theta")}
    phase, frequency = rng.uniform(0, 2 * np.pi, (DRIVES, 1, nu)), rng.uniform(0.5, 2.0, (DRIVES, 1, nu))
    wave = np.sin(2 * np.pi * frequency * t[None, :, None] + phase) - np.sin(phase)
    command = middle + 0.5 * size * wave  # begins at rest, so that no delay line and no filter has a past
    drive = Drive(robot.step, 0, command, None, np.zeros(DRIVES), None)
    wanted = tuple(f"position.{j}" for j in robot.joints)
    starts: list[dict[str, Any]] = [{c: v[row : row + 1] for c, v in home.items()} for row in range(DRIVES)]
    found = np.stack([_played(robot, model, start, u) for start, u in zip(starts, command, strict=True)])
    worst = []
    for settings in hypotheses:
        expected = replay(robot, home, drive, settings.take(np.zeros(DRIVES, dtype=int)), wanted)
        difference = np.abs(found - np.stack([expected[c] for c in wanted], axis=-1))
        worst.append(float(np.nan_to_num(difference, nan=np.inf).max()))
    return tuple(worst), DRIVES * steps


def _played(robot: CompiledRobot, model: "mujoco.MjModel", start: dict[str, Any], command: np.ndarray) -> np.ndarray:
    """(steps + 1, joints) positions of the written model under commands (steps, nu)."""
    import mujoco

    data = mujoco.MjData(model)
    write_start(robot, data.qpos[None], data.qvel[None], start)
    data.ctrl[:] = command[0]
    for i in range(model.nu):
        if model.actuator_historyadr[i] >= 0:
            n = int(model.actuator_history[i, 0])
            past = -robot.step * np.arange(n, 0, -1)
            mujoco.mj_initCtrlHistory(model, data, i, past, np.full(n, command[0, i]))
        if model.actuator_actadr[i] >= 0:
            data.act[model.actuator_actadr[i]] = command[0, i]
    out = [data.qpos[robot.places].copy()]
    for u in command:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        out.append(data.qpos[robot.places].copy())
    return np.array(out)


def _reach(robot: CompiledRobot) -> tuple[np.ndarray, np.ndarray]:
    """(nu,) command that the model rests at, and how far one may go from it."""
    import mujoco

    model = robot.model
    data = mujoco.MjData(model)
    home = model.actuator_gear[:, 0] * data.qpos[robot.places[robot.driven]]
    limited_ = model.actuator_ctrllimited.astype(bool)
    width = np.where(limited_, np.ptp(model.actuator_ctrlrange, axis=1), 1.0)
    return np.where(robot.servo, home, 0.0), np.minimum(0.25 * width, 0.5)
