"""Runs cut into windows, ready to be replayed: what was measured, what was sent, and the start of each window."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.local_fit import local_fit
from residual_mpc.diagnosis.noise_model import ChannelNoise
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run, held
from residual_mpc.logs.signals import noise_sigma, resolution, unwrap_with_gaps
from residual_mpc.models.protocol import Drive, Inverting, Merging, Robot

LEAD = 1.2  # s of commands before a window, that warm up what remembers
POSITION_LIKE = ("position", "pose")
MOVES_STEPS = 3.0  # of the resolution, within which a channel stands still
MOVES_SHARE = 0.02  # of its samples that differ from the one before


@dataclass(frozen=True)
class Signal:
    """The samples of one channel of one run that are not missing: t (n,) s, y (n,) channel unit."""

    t: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Block:
    """The windows of the runs that share one robot model (a variant), as rows `where` of the dataset's arrays."""

    robot: Robot
    where: slice
    drive: Drive


@dataclass(frozen=True)
class Dataset:
    """W windows of at most M samples of C channels.

    run (W,) index into `runs`; start (W,) s; t (W, M) s since the window's start, NaN where padded; y (W, M, C),
    NaN where missing; compared (W, C) whether the gap compares that channel; sigma (C,) and steps (C,) the 1-sigma
    noise from sample to sample and the quantisation of each channel, channel units; noise: each channel's noise with
    its colour, which `sigma` does not see; stated: the 1-sigma that the user gives for a channel.
    """

    runs: tuple[Run, ...]
    channels: tuple[str, ...]
    blocks: tuple[Block, ...]
    signals: Mapping[tuple[int, str], Signal]
    run: np.ndarray
    start: np.ndarray
    t: np.ndarray
    y: np.ndarray
    compared: np.ndarray
    sigma: np.ndarray
    steps: np.ndarray
    noise: tuple[ChannelNoise, ...]
    stated: Mapping[str, float]
    horizon: float
    skipped: int

    @property
    def count(self) -> int:
        return len(self.start)

    def take(self, keep: np.ndarray) -> "Dataset":
        """The windows where the mask (W,) is true."""
        blocks, first = [], 0
        for b in self.blocks:
            rows = keep[b.where]
            n = int(rows.sum())
            if n:
                drive = replace(
                    b.drive,
                    command=b.drive.command[rows],
                    enabled=None if b.drive.enabled is None else b.drive.enabled[rows],
                    enabled_before=None if b.drive.enabled_before is None else b.drive.enabled_before[rows],
                    clock=b.drive.clock[rows],
                    setting=None if b.drive.setting is None else b.drive.setting[rows],
                )
                blocks.append(Block(b.robot, slice(first, first + n), drive))
                first += n
        return replace(
            self,
            blocks=tuple(blocks),
            run=self.run[keep],
            start=self.start[keep],
            t=self.t[keep],
            y=self.y[keep],
            compared=self.compared[keep],
        )


def joined(parts: Sequence[Dataset]) -> Dataset:
    """The windows of several datasets of the same runs, of different horizons, as one."""
    first = parts[0]
    m = max(d.t.shape[1] for d in parts)

    def padded(x: np.ndarray) -> np.ndarray:
        return np.pad(x, [(0, 0), (0, m - x.shape[1])] + [(0, 0)] * (x.ndim - 2), constant_values=np.nan)

    blocks, at = [], 0
    for d in parts:
        blocks += [Block(b.robot, slice(at + b.where.start, at + b.where.stop), b.drive) for b in d.blocks]
        at += d.count
    return replace(
        first,
        blocks=tuple(blocks),
        run=np.concatenate([d.run for d in parts]),
        start=np.concatenate([d.start for d in parts]),
        t=np.concatenate([padded(d.t) for d in parts]),
        y=np.concatenate([padded(d.y) for d in parts]),
        compared=np.concatenate([d.compared for d in parts]),
        horizon=max(d.horizon for d in parts),
        skipped=sum(d.skipped for d in parts),
    )


def build_dataset(
    runs: Sequence[Run],
    robots: Sequence[Robot],
    noise: Mapping[str, float],
    horizon: float = 1.0,
    starts: Sequence[np.ndarray] | None = None,
) -> Dataset:
    """Cut runs into windows. robots[i] is the model of runs[i] (the same object for runs that share one);
    starts[i] (W,) s: where the windows of runs[i] begin; None: as the gap has them.

    Raises BadInput where no window has a measured start.
    """
    runs = tuple(runs)
    robots, setting = _merge(robots)
    measured = [r.measured for r in runs]
    channels = tuple(sorted({c for cs, m in zip(measured, robots, strict=True) for c in cs if c in m.channels}))
    signals = {(i, c): _signal(r, c) for i, r in enumerate(runs) for c in channels if c in measured[i]}
    cut = [window_starts(r, horizon) for r in runs] if starts is None else list(starts)
    order = sorted(range(len(runs)), key=lambda i: [id(m) for m in robots].index(id(robots[i])))
    blocks, index, starts, first, skipped = [], [], [], 0, 0
    for robot in dict.fromkeys(robots[i] for i in order):
        mine = [i for i in order if robots[i] == robot]
        kept = []
        for i in mine:
            good = _has_start(runs[i], cut[i], signals, i)
            skipped += int((~good).sum())
            kept.append(cut[i][good])
        n = sum(len(k) for k in kept)
        if n == 0:
            continue
        drive = _drive(robot, [runs[i] for i in mine], kept, horizon, mine, signals)
        if setting is not None:
            drive = replace(drive, setting=np.repeat([setting[i] for i in mine], [len(k) for k in kept]))
        blocks.append(Block(robot, slice(first, first + n), drive))
        index += [np.full(len(k), i) for i, k in zip(mine, kept, strict=True)]
        starts += kept
        first += n
    if not first:
        raise BadInput(
            f"none of {skipped} windows has a measured start",
            "runs",
            "every measured position or pose needs a sample within 0.25 s of it: see `residual-mpc check`",
        )
    run, start = np.concatenate(index), np.concatenate(starts)
    t, y = _samples(runs, run, start, channels, signals, horizon)
    of_run = [compared_channels(m, channels) for m in measured]
    compared = np.array([[c in of_run[i] for c in channels] for i in run])
    sigma, steps = _noise(channels, signals, noise)
    white = tuple(ChannelNoise(float(s)) for s in sigma)
    return Dataset(
        runs, channels, tuple(blocks), signals, run, start, t, y, compared, sigma, steps, white, dict(noise), horizon,
        skipped,
    )  # fmt: skip


def _merge(robots: Sequence[Robot]) -> tuple[Sequence[Robot], list[int] | None]:
    """The robots with all settings of one merged where it can be, and which setting each run has."""
    distinct = list(dict.fromkeys(robots))
    first = distinct[0]
    if len(distinct) < 2 or not isinstance(first, Merging):
        return robots, None
    whole = first.merged(distinct[1:])
    return (robots, None) if whole is None else ([whole] * len(robots), [distinct.index(r) for r in robots])


def window_starts(run: Run, horizon: float) -> np.ndarray:
    """(W,) s: every `horizon` from the first stamp; a window counts if the last stamp is within a period of its end."""
    length = run.t[-1] - run.t[0]
    if length < horizon:
        return run.t[:1].copy()
    n = int(np.floor((length + run.period) / horizon + 1e-9))
    return np.asarray(run.t[0] + horizon * np.arange(n))


def compared_channels(measured: Sequence[str], channels: Sequence[str]) -> tuple[str, ...]:
    """The position-like channels of a run that are measured; its velocities where it has nothing else."""
    mine = [c for c in channels if c in measured]
    like = [c for c in mine if c.split(".")[0] in POSITION_LIKE]
    return tuple(like or mine)


def _signal(run: Run, channel: str) -> Signal:
    y = run.columns[channel]
    if channel == "pose.theta" or channel.startswith("position."):
        y = unwrap_with_gaps(y)
    good = np.isfinite(y)
    return Signal(run.t[good], y[good])


def _has_start(run: Run, starts: np.ndarray, signals: Mapping[tuple[int, str], Signal], i: int) -> np.ndarray:
    """(W,) whether every measured position-like channel has a sample within reach of the window's start."""
    good = np.ones(len(starts), dtype=bool)
    for (j, c), s in signals.items():
        if j == i and c.split(".")[0] in POSITION_LIKE:
            good &= local_fit(s.t, starts).count > 0
    return good


def _samples(
    runs: Sequence[Run],
    run: np.ndarray,
    start: np.ndarray,
    channels: Sequence[str],
    signals: Mapping[tuple[int, str], Signal],
    horizon: float,
) -> tuple[np.ndarray, np.ndarray]:
    spans = []
    for i, t0 in zip(run, start, strict=True):
        t = runs[i].t
        spans.append((np.searchsorted(t, t0 - 1e-9), np.searchsorted(t, t0 + horizon + 1e-9)))
    m = max(b - a for a, b in spans)
    t_out = np.full((len(start), m), np.nan)
    y_out = np.full((len(start), m, len(channels)), np.nan)
    full: dict[tuple[int, str], np.ndarray] = {}
    for (i, c), s in signals.items():
        column = np.full(len(runs[i].t), np.nan)
        column[np.searchsorted(runs[i].t, s.t)] = s.y
        full[i, c] = column
    for w, (i, (a, b)) in enumerate(zip(run, spans, strict=True)):
        t_out[w, : b - a] = runs[i].t[a:b] - start[w]
        for k, c in enumerate(channels):
            if (i, c) in full:
                y_out[w, : b - a, k] = full[i, c][a:b]
    return t_out, y_out


def _noise(
    channels: Sequence[str], signals: Mapping[tuple[int, str], Signal], given: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """(C,) 1-sigma noise from sample to sample and (C,) resolution, channel units.

    Both come from the longest runs in which the channel moves: a channel that stands still repeats itself, which says
    nothing of its noise. One that never moves is given the largest noise among the channels of its kind.
    """
    sigma, steps = np.zeros(len(channels)), np.zeros(len(channels))
    moves = np.zeros(len(channels), dtype=bool)
    for k, c in enumerate(channels):
        mine = [s for (_, name), s in signals.items() if name == c and len(s.t) >= 8]
        step = float(np.median([resolution(s.y) for s in mine if np.ptp(s.y) > 0.0] or [0.0]))
        moving = [s for s in mine if _moves(s, step)]
        moves[k] = bool(moving) or c in given
        longest = sorted(moving or mine, key=lambda s: -len(s.t))[:12]
        found = [x for s in longest if np.isfinite(x := noise_sigma(s.t, s.y))]
        estimate = float(np.median(found)) if found else 0.0
        sigma[k] = max(given.get(c, estimate), step / np.sqrt(12.0), 1e-9)
        steps[k] = step
    for k in map(int, np.flatnonzero(~moves)):
        alike = [sigma[j] for j, c in enumerate(channels) if moves[j] and c.split(".")[0] == channels[k].split(".")[0]]
        sigma[k] = max([sigma[k], *alike])
    return sigma, steps


def _moves(signal: Signal, step: float) -> bool:
    """Whether a channel moves in a run: by more than a few steps, and in more than a few of its samples."""
    changes = np.count_nonzero(np.diff(signal.y))
    return bool(np.ptp(signal.y) > MOVES_STEPS * step and changes > MOVES_SHARE * len(signal.y))


def _drive(
    robot: Robot,
    runs: Sequence[Run],
    starts: Sequence[np.ndarray],
    horizon: float,
    index: Sequence[int],
    signals: Mapping[tuple[int, str], Signal],
) -> Drive:
    dt = robot.step or float(np.clip(min(r.period for r in runs) / 4.0, 0.004, 0.01))
    steps = int(np.ceil(horizon / dt - 1e-9))
    lead = int(np.ceil(LEAD / dt))
    commands, enabled, clocks = [], [], []
    for run, t0, i in zip(runs, starts, index, strict=True):
        edges = t0[:, None] + dt * np.arange(-lead, steps + 1)[None, :]
        per_actuator = [
            _mean_held(run, held(run, f"command.{a}"), edges, _resting(robot, k, run, i, signals))
            for k, a in enumerate(robot.actuators)
        ]
        warm = np.stack(per_actuator, axis=-1)
        for k in range(len(robot.actuators)):
            _settle(warm[:, 0, k], robot, k, i, edges[:, 0], signals)
        commands.append(warm)
        clocks.append(t0 - run.t[0])
        centres = 0.5 * (edges[:, :-1] + edges[:, 1:])
        at = np.clip(np.searchsorted(run.t, centres, side="right") - 1, 0, len(run.t) - 1)
        on = [
            held(run, f"enabled.{a}")[at] if f"enabled.{a}" in run.columns else np.ones(at.shape)
            for a in robot.actuators
        ]
        enabled.append(np.where(np.isnan(on), 1.0, on).transpose(1, 2, 0))
    on_all = np.concatenate(enabled)
    always = bool((on_all == 1).all())
    return Drive(
        dt,
        lead,
        np.concatenate(commands),
        None if always else on_all[:, lead:],
        np.concatenate(clocks),
        enabled_before=None if always else on_all[:, :lead],
    )


def _resting(robot: Robot, k: int, run: Run, i: int, signals: Mapping[tuple[int, str], Signal]) -> float | None:
    """What the actuator held before the first stamp, if the run measured it: a wheel's speed, a servo's position. Where
    only the robot's own motion was measured, that tells standstill from the first command; None: the first command."""
    kind = {"speed": "velocity", "velocity": "velocity", "position": "position"}.get(robot.command_kinds[k])
    joints = getattr(robot, "actuator_joints", robot.actuators)
    signal = signals.get((i, f"{kind}.{joints[k]}"))
    if signal is not None and len(signal.y):
        return float(signal.y[0])
    sources = {s.position: signals.get((i, s.position)) for s in robot.states}
    known = {c: s for c, s in sources.items() if s is not None and len(s.y) > 1}
    if not isinstance(robot, Inverting) or len(known) < len(sources):
        return None
    at = run.t[:1]
    fits = {c: (local_fit(s.t, at), s) for c, s in known.items()}
    value = {c: float(np.nan_to_num(f.value(s.y)[0])) for c, (f, s) in fits.items()}
    rate = {c: float(np.nan_to_num(f.slope(s.y)[0])) for c, (f, s) in fits.items()}
    moving = robot.outputs_from(value, rate)
    first = {a: float(held(run, f"command.{a}")[0]) for a in robot.actuators}
    still = sum(moving[a] ** 2 - (moving[a] - first[a]) ** 2 for a in robot.actuators) < 0.0
    return 0.0 if still else None


def _settle(
    first: np.ndarray, robot: Robot, k: int, i: int, at: np.ndarray, signals: Mapping[tuple[int, str], Signal]
) -> None:
    """Let the warm-up of a wheel begin at its measured speed: a lag as long as the warm-up would still hold its first
    command. first (W,): the first command of each window's warm-up, changed in place; at (W,) s."""
    joints = getattr(robot, "actuator_joints", robot.actuators)
    signal = signals.get((i, f"velocity.{joints[k]}"))
    if robot.command_kinds[k] != "speed" or signal is None:
        return
    fit = local_fit(signal.t, at)
    first[:] = np.where(fit.count > 0, fit.value(signal.y), first)


def _mean_held(run: Run, u: np.ndarray, edges: np.ndarray, before: float | None) -> np.ndarray:
    """(W, K) mean of the held command u (n,) over each interval of edges (W, K + 1) s."""
    t = run.t
    first = u[0] if before is None else before
    total = np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(t))])
    at = np.searchsorted(t, edges, side="right") - 1
    inside = np.clip(at, 0, len(t) - 1)
    integral = np.where(at < 0, first * (edges - t[0]), total[inside] + u[inside] * (edges - t[inside]))
    return np.asarray(np.diff(integral, axis=1) / np.diff(edges, axis=1))
