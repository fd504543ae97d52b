"""Largest difference between the step of a robot with inertia and its replay, over sampled moves."""

from dataclasses import replace

import numpy as np

from residual_mpc.export.augmented import Augmented, with_residual
from residual_mpc.export.command_grid import CommandGrid
from residual_mpc.learning.forms.residual_robot import residual_robot
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive, Robot

ROWS, SECONDS = 20, 0.5
SPEED = 0.3  # rad/s (m/s), largest of a joint at the start
SWING = 0.05  # amplitude of a command about the one that holds the posture, as a share of its range
LEAD = 0.32  # s of commands before a move, for delays


def moving_apart(model: Augmented, rng: np.random.Generator) -> float:
    """Largest difference of a position, rad or m, over `SECONDS` s of `ROWS` moves.

    A move begins in the middle half of the joints' ranges. Its commands are sinusoids about those that hold the arm
    there, with an amplitude of a twentieth of their range.
    """
    plain = replace(model, build=replace(model.build, smooth=0.0, disturbances=False))
    learned = model.residual
    if learned is not None and (learned.form != "joint" or abs(learned.step - model.build.dt) > 1e-9):
        learned = None
    bare = with_residual(plain, learned)
    at, robot, dt = bare.stepped, bare.robot, model.build.dt
    x, u = _moves(bare, rng)
    places = [[at.states.index(c) for c in channels] for channels in (at.poses, at.rates)]
    grid = CommandGrid(dt, robot.step or dt)
    lead = int(np.ceil(LEAD / grid.step))
    before = np.repeat(_held(bare, x)[:, None], lead, axis=1)
    command = np.concatenate([before, grid.commands(u)], axis=1)
    drive = Drive(grid.step, lead, command, None, np.full(ROWS, model.build.clock))
    start = _at_rest(robot) | dict(zip((*at.poses, *at.rates), x[:, [*places[0], *places[1]]].T, strict=True))
    source = robot if learned is None else residual_robot(robot, learned)
    nodes = source.replay(start, drive, bare.settings.take(np.zeros(ROWS, dtype=int)), at.poses)
    worst = 0.0
    for k in range(u.shape[1]):
        x = bare.numpy_step(x, u[:, k])
        there = np.stack([grid.at_sample(nodes[c], k + 1) for c in at.poses], axis=-1)
        worst = max(worst, float(np.nan_to_num(np.abs(x[:, places[0]] - there), nan=np.inf).max()))
    return worst


def _at_rest(robot: Robot) -> dict[str, np.ndarray]:
    """(ROWS,) positions and speeds at which the robot rests, for joints that the step holds."""
    rest = {s.position: optional.rest(robot).get(s.position, 0.0) for s in robot.states}
    moving = dict.fromkeys((s.velocity for s in robot.states if s.velocity is not None), 0.0)
    return {channel: np.full(ROWS, value) for channel, value in (rest | moving).items()}


def _moves(model: Augmented, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(ROWS, nx) starts and (ROWS, steps, nu) commands."""
    at, steps = model.stepped, int(np.ceil(SECONDS / model.build.dt))
    low, high = (np.array(side) for side in zip(*at.spans, strict=True))
    postures = rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high, (ROWS, len(low)))
    x = np.stack([model.start(dict(zip(at.poses, row.tolist(), strict=True))) for row in postures])
    hold = _held(model, x)
    x[:, [at.states.index(c) for c in at.rates]] = rng.uniform(-SPEED, SPEED, (ROWS, len(at.rates)))
    low, high = (np.array(side) for side in zip(*at.reach, strict=True))
    t = model.build.dt * np.arange(steps)
    wave = np.sin(2 * np.pi * rng.uniform(0.3, 0.7, (ROWS, 1, model.nu)) * t[None, :, None])
    return x, np.clip(hold[:, None] + SWING * np.minimum(high - low, 2.0 * np.pi) * wave, low, high)


def _held(model: Augmented, x: np.ndarray) -> np.ndarray:
    """(ROWS, nu) commands that hold the arm at the states x (ROWS, nx)."""
    return np.stack([model.hold(row) for row in x])
