"""How far an exported model lies from its source, over sampled points: every export states it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.effects.ops import NUMPY
from residual_mpc.export.augmented import Augmented, with_residual
from residual_mpc.export.command_grid import CommandGrid
from residual_mpc.export.moving import moving_apart
from residual_mpc.export.network import READS, remembered, residual_delta
from residual_mpc.learning.forms.residual_robot import residual_robot
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models import optional
from residual_mpc.models.protocol import Drive, Robot

Step = Callable[[np.ndarray, np.ndarray], np.ndarray]  # x (n, nx), u (n, nu) -> x+ (n, nx)
NETWORK_UNIT = "in the units of the network's outputs"
PREFACE = 4.0  # s of steady motion: it fills every memory, and puts play on a known stop
# m or rad: for no arm, servo or effect tested does the step deviate from the replay by more within a move (figures in
# docs/results/control.md), so that a larger deviation means that the step models something differently
USUAL = 0.008
BEYOND = 1.5  # times the limit of a network's inputs: the export has to hold them where the learned network does


@dataclass(frozen=True)
class Sampling:
    """points: sampled states and commands; steps: of a replayed trajectory; command: largest, actuator units, where
    no network's limit asks for more; pose: largest coordinate, m and rad. A robot that states the reach of its commands
    is sampled within it, and its trajectory goes from one posture to another in `move` s.
    """

    points: int = 500
    steps: int = 40
    command: float = 10.0
    pose: float = 3.0
    move: float = 1.0


@dataclass(frozen=True)
class Agreement:
    """Largest absolute differences, each in the unit of the state at fault.

    step: the exported step against the model in numpy, at sampled states and commands. replay: the model in numpy
    against the replay of diagnosis and learning, over sampled trajectories of poses; where the network was learned at
    another step, or on a task, without it.
    network: the exported network against the learned one, in its outputs' units; 0 without one. unit: of the largest.
    """

    step: float
    replay: float
    network: float
    points: int
    unit: str

    @property
    def largest(self) -> float:
        return float(np.max([self.step, self.replay, self.network]))  # NaN if any of them is


def agreement(model: Augmented, step: Step, rng: np.random.Generator, sampling: Sampling | None = None) -> Agreement:
    """Compare an exported step with what it was made from."""
    s = sampling or Sampling()
    x, u = sample(model, rng, s)
    each = np.abs(step(x, u) - model.numpy_step(x, u)).max(axis=0)
    apart, replay, network = float(each.max()), _from_replay(model, rng, s), _network(model, rng, s)
    unit = model.stepped.units[int(each.argmax())]
    if max(replay, network) > apart:
        unit = position_unit(model.robot) if replay >= network else NETWORK_UNIT
    return Agreement(apart, replay, network, s.points, unit)


def far_from_replay(apart: Agreement, model: Augmented) -> list[str]:
    """Warnings about a step that deviates from the replay by more than steps usually do."""
    if not apart.replay > USUAL:
        return []
    unit = position_unit(model.robot)
    missing = dict.fromkeys(what.split(":")[0].split(" ")[0] for what in model.stepped.left_out)
    effects = ", ".join(name for name in missing if name in model.settings.effects)
    because = f"; it leaves out {effects}" if effects else ""
    return [
        f"over sampled moves the step is up to {apart.replay:.2g} {unit} off the replay that the diagnosis used, "
        f"where steps usually stay within {USUAL:g}{because}. Check it against your logs, or try another time step"
    ]


def position_unit(robot: Robot) -> str:
    """The unit of a difference between positions of a robot: "rad", "m", or either."""
    lengths = {"pose.x", "pose.y", *(f"position.{joint}" for joint in optional.sliding(robot))}
    places = [c for c in robot.channels if c.startswith(("pose.", "position."))]
    return " or ".join(unit for unit, found in (("m", lengths), ("rad", {*places} - lengths)) if found & {*places})


def sample(model: Augmented, rng: np.random.Generator, s: Sampling) -> tuple[np.ndarray, np.ndarray]:
    """(points, nx) states and (points, nu) commands that may occur: states reached by driving at random.

    Where a network holds its inputs within a limit, a quarter of the points lies on both sides of it.
    """
    at = model.start()
    x = np.repeat(at[None], s.points, axis=0)
    low, high = _reach(model, s.command)
    u = rng.uniform(low, high, (s.points, model.nu))
    for _ in range(12):
        x = model.numpy_step(x, u)
        u = rng.uniform(low, high, u.shape)
    spans = model.stepped.spans or model.stepped.reach
    for i, name in enumerate(model.stepped.poses):
        span = spans[i] if spans else (-s.pose, s.pose)
        x[:, model.stepped.states.index(name)] = rng.uniform(*span, s.points)
    for name in model.stepped.rates:
        x[:, model.stepped.states.index(name)] = rng.uniform(-1.0, 1.0, s.points)
    r = model.residual
    if r is not None and np.isfinite(r.limit) and r.form in READS:
        far = slice(3 * s.points // 4, None)
        z = _inputs(r, rng, s.points)[far]
        for i, name in enumerate(remembered(r)):
            x[far, model.stepped.states.index(f"last.{name}")] = z[:, i]
        u[far] = z[:, -model.nu :]
    return x, u


def _reach(model: Augmented, command: float) -> tuple[np.ndarray, np.ndarray]:
    """(nu,) lowest and highest commands to sample."""
    reach = model.stepped.reach or ((-command, command),) * model.nu
    return np.array([r[0] for r in reach]), np.array([r[1] for r in reach])


def _inputs(r: Residual, rng: np.random.Generator, points: int) -> np.ndarray:
    """(points, inputs) in physical units, beyond the limit where there is one."""
    most = BEYOND * r.limit if np.isfinite(r.limit) else 3.0
    return np.asarray(r.input_mean + r.input_scale * rng.uniform(-most, most, (points, r.net.inputs)))


def _from_replay(model: Augmented, rng: np.random.Generator, s: Sampling) -> float:
    if model.stepped.rates:
        return moving_apart(model, rng)
    learned = model.residual
    if learned is not None and (abs(learned.step - model.build.dt) > 1e-9 or learned.form not in READS):
        learned = None
    bare = with_residual(model, learned)
    if model.build.disturbances or model.build.smooth > 0:  # a replay knows neither: they are 0 in the comparison
        bare = with_residual(replace(model, build=replace(model.build, smooth=0.0, disturbances=False)), learned)
    u = _trajectories(bare, learned, rng, s)
    dt, (rows, steps, _) = model.build.dt, u.shape
    lead = int(np.ceil(PREFACE / dt))
    at = bare.start()
    states = bare.stepped.states
    start = {c: np.full(rows, at[states.index(c)] if c in states else 0.0) for c in _start_channels(bare)}
    grid = CommandGrid(dt, bare.robot.step or dt)
    drive = Drive(grid.step, 0, grid.commands(u), None, np.full(rows, model.build.clock))
    source = bare.robot if learned is None else residual_robot(bare.robot, learned)
    nodes = source.replay(start, drive, bare.settings.take(np.zeros(rows, dtype=int)), bare.stepped.poses)
    x = np.repeat(at[None], rows, axis=0)
    for k in range(lead):
        x = bare.numpy_step(x, u[:, k])
    where = [states.index(c) for c in bare.stepped.poses]
    x[:, where] = np.stack([grid.at_sample(nodes[c], lead) for c in bare.stepped.poses], axis=-1)
    worst = 0.0
    for k in range(lead, steps):
        x = bare.numpy_step(x, u[:, k])
        there = np.stack([grid.at_sample(nodes[c], k + 1) for c in bare.stepped.poses], axis=-1)
        worst = float(np.maximum(worst, np.abs(x[:, where] - there).max()))  # NaN stays
    return worst


def _start_channels(model: Augmented) -> tuple[str, ...]:
    """What a replay has to be told of its start."""
    return tuple(c for s in model.robot.states for c in (s.position, s.velocity) if c is not None)


def _trajectories(model: Augmented, learned: Residual | None, rng: np.random.Generator, s: Sampling) -> np.ndarray:
    """(rows, lead + steps, nu) commands: a preface that is held, then what is compared."""
    rows, lead = 20, int(np.ceil(PREFACE / model.build.dt))
    if model.stepped.reach:  # from posture to posture, as such a robot is driven
        low, high = _reach(model, s.command)
        between = rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high, (2, rows, 1, model.nu))
        steps = int(np.ceil(s.move / model.build.dt))
        part = np.concatenate([np.zeros(lead), 0.5 * (1.0 - np.cos(np.pi * np.arange(1, steps + 1) / steps))])
        return np.asarray(between[0] + (between[1] - between[0]) * part[:, None])
    u = rng.uniform(-s.command, s.command, (rows, lead + s.steps, model.nu))
    if learned is not None and np.isfinite(learned.limit):
        most = np.maximum(s.command, BEYOND * learned.limit * learned.input_scale[-model.nu :])
        u[::2] *= most / s.command
    u[:, :lead] = s.command
    return u


def _network(model: Augmented, rng: np.random.Generator, s: Sampling) -> float:
    if model.residual is None:
        return 0.0
    r = model.residual
    z = _inputs(r, rng, s.points)
    out = residual_delta(NUMPY, r, [*r.theta], [*z.T], model.build.smooth)
    return float(np.abs(np.stack(out, axis=-1) - r(z)).max())
