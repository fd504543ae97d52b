"""Where motor and link are at a window's start, of which only one side is logged."""

from typing import Any

import numpy as np

from plants.mujoco_robot.edits.split_gears import FAR, of_gears
from plants.mujoco_robot.simulation.compiled_steps import lead_natively
from plants.mujoco_robot.simulation.gear_feedback import Feedback, on_link_side
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.gears import Gears
from residual_mpc.models.settings import Settings

NUDGE = 1e-4  # rad
SOLVES = 12  # Newton steps at most
LEADS = 0.1  # the slope is kept while each of its steps cuts the error to less than this share (chord method)
SOLVED = 1e-6  # rad, a step after which no other is needed
HELD = 1e-9  # rad, within which a command counts as the same
WARM = 0.6  # s of commands before a window, replayed to know how motor and link swing against each other


def begin(
    batch: Any, robot: CompiledRobot, settings: Settings, u: np.ndarray, warm: int, servos: Feedback | None
) -> None:
    """Put motor and link where they are at a window's start, given their logged side; in place.

    How far the link is ahead is not measured. The rule (see `settle`) says where it is but for its fast motion, and
    that is taken from a replay of the commands before the window, u[:, :warm] (B, warm + K, nu): what lies between this
    replay's end and the rule's word on that end, and its rate. If the command has not changed, the robot is at
    rest, and nothing is replayed.
    """
    gears = robot.gears
    assert gears is not None
    q, v = batch.bind("qpos"), batch.bind("qvel")
    start = q.copy(), v.copy()
    fast, rate = np.zeros((settings.rows, len(gears.joints))), np.zeros((settings.rows, len(gears.joints)))
    moving = (np.abs(u[:, :warm] - u[:, :1]) > HELD).any(axis=(1, 2))
    if moving.any() and "torque" not in robot.command_kinds:  # torques alone, without a servo, would lead anywhere
        _lead(batch, robot, settings, u[:, :warm], u[:, warm], servos, np.flatnonzero(moving))
        end = q.copy(), v.copy()
        on_link_side(robot, q, v)
        _unwind(q, v, gears)
        settle(batch, robot, settings, u[:, warm], servos)
        fast = np.where(moving[:, None], np.nan_to_num(end[0][:, gears.places] - q[:, gears.places]), 0.0)
        rate = np.where(moving[:, None], np.nan_to_num(end[1][:, gears.dofs]), 0.0)
        q[:], v[:] = start
    settle(batch, robot, settings, u[:, warm], servos, fast)
    v[:, gears.dofs] = rate
    if robot.position_sensor == "link":
        v[:, robot.dofs[gears.joints]] -= rate


def _lead(
    batch: Any,
    robot: CompiledRobot,
    settings: Settings,
    u: np.ndarray,
    now: np.ndarray,
    servos: Feedback | None,
    moving: np.ndarray,
) -> None:
    """Replay commands u (B, K, nu) that end at the window's start, from where the servos would have held the robot, in
    the rows numbered `moving` (m,); the others stay there.

    Where a spring's own swing would outlast the replay, they are taken to err as they do at the window's start, under
    the command now (B, nu)."""
    import mujoco

    model = robot.model
    q, v = batch.bind("qpos"), batch.bind("qvel")
    gear, driven = model.actuator_gear[:, 0], robot.driven
    sprung = np.isfinite(of_gears(robot, settings)[0]).any(axis=1)
    v[:] = 0.0
    for i, kind in enumerate(robot.command_kinds):
        at = robot.places[driven[i]]
        if kind == "position":
            q[:, at] = np.where(sprung, q[:, at] + (u[:, 0, i] - now[:, i]) / gear[i], u[:, 0, i] / gear[i])
        else:  # it came from where its speeds have led it away
            q[:, at] -= u[:, :, i].sum(axis=1) * robot.substeps * model.opt.timestep / gear[i]
    settle(batch, robot, settings, u[:, 0], servos)
    moving = lead_natively(batch, robot, u, moving, servos)
    if not len(moving):
        return
    if servos is None:
        held = np.repeat(u[moving], robot.substeps, axis=1)
        batch.rollout(held.shape[1], np.ascontiguousarray(held), int(mujoco.mjtState.mjSTATE_CTRL), ("qpos",), moving)
        return
    control = batch.bind("ctrl")
    for k in range(u.shape[1]):
        control[:] = u[:, k]
        servos.correct(control, robot, q, v)
        batch.step(moving, nstep=robot.substeps)


def _unwind(q: np.ndarray, v: np.ndarray, gears: Gears) -> None:
    """Motor and link in one place, at one speed; in place."""
    q[:, gears.places], v[:, gears.dofs] = 0.0, 0.0


def settle(
    batch: Any,
    robot: CompiledRobot,
    settings: Settings,
    command: np.ndarray,
    servos: Feedback | None,
    fast: np.ndarray | float = 0.0,
) -> None:
    """Part motor and link, which are in one place, by as much as lets both gather speed alike; in place.

    Under the command (B, nu), gravity and friction: the spring bears what the link needs, as it does but for its own
    fast oscillation (Spong 1987, the slow manifold), and within its play the link lies on the side that the load pushes
    it to. Their logged side stays where it is. fast (B, g) rad is added, as far as the play has room.
    """
    gears = robot.gears
    assert gears is not None
    q, v, control = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
    stiffness, gap = of_gears(robot, settings)
    loose = ~np.isfinite(stiffness)
    half = np.where(loose, 0.5 * gap, np.inf)
    motor, count = robot.places[gears.joints], len(gears.joints)
    measured, acceleration = q[:, motor].copy(), batch.bind("qacc")
    stops, dead = batch.expand("jnt_range"), batch.expand("tendon_lengthspring")
    kept = stops[:, gears.numbers].copy(), dead[:, gears.springs].copy()
    stops[:, gears.numbers], dead[:, gears.springs] = (-FAR, FAR), 0.0

    def place(ahead: np.ndarray) -> None:
        q[:, gears.places] = ahead
        q[:, motor] = measured - ahead if robot.position_sensor == "link" else measured

    def apart(ahead: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(B, g) rad/s^2, acceleration of the link relative to the motor, valid in `rows` (B,) bool alone."""
        place(ahead)
        control[:] = command
        if servos is not None:
            servos.correct(control, robot, q, v)
        batch.forward(np.flatnonzero(rows))
        return np.asarray(acceleration[:, gears.dofs]).copy()

    going = np.ones(len(half), dtype=bool)  # rows that are not solved: the steps of a row do not hang on the others
    ahead = np.zeros_like(half)
    low, high = np.full_like(half, -np.inf), np.full_like(half, np.inf)
    diagonal = np.arange(count)
    slope, error = np.zeros((len(half), count, count)), np.zeros(len(half))
    led = np.zeros(len(half), dtype=bool)  # rows whose last step was the slope's own
    for _ in range(SOLVES):
        away = apart(ahead, going)
        leaning = loose & (((ahead >= half) & (away > 0)) | ((ahead <= -half) & (away < 0)))
        last, error = error, np.abs(np.where(leaning, 0.0, away)).max(axis=1)
        if (anew := going & ~(led & (error < LEADS * last))).any():
            moved = np.stack([apart(ahead + NUDGE * row, anew) for row in np.eye(count)], axis=-1)
            slope[anew] = (moved[anew] - away[anew, :, None]) / NUDGE
            # without a servo nothing pulls back
            slope[:, diagonal, diagonal] = np.minimum(slope[:, diagonal, diagonal], -1.0)
        system = np.where(leaning[:, :, None], np.eye(count), slope)
        step = np.linalg.solve(system, np.where(leaning, 0.0, away)[:, :, None])[:, :, 0]
        low, high = np.where(away > 0, ahead, low), np.where(away < 0, ahead, high)
        newton = ahead - step
        # at a motor's limit its servo's stiffness is not seen, and a step leads too far
        beyond = (newton < low) | (newton > high)
        bracketed = beyond & np.isfinite(low) & np.isfinite(high)
        newton = np.where(bracketed, 0.5 * (np.where(bracketed, low, 0.0) + np.where(bracketed, high, 0.0)), newton)
        solved = (np.abs(newton - ahead) < SOLVED).all(axis=1)
        led[:] = ~(bracketed | (np.abs(newton) > half)).any(axis=1)
        ahead = np.where(going[:, None], np.clip(newton, -half, half), ahead)
        going &= ~solved
        if not going.any():
            break
    stops[:, gears.numbers], dead[:, gears.springs] = kept
    place(np.where(loose, np.clip(ahead + fast, -half, half), ahead + 0.5 * gap * np.sign(ahead) + fast))
