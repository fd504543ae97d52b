"""Runs cut into windows, ready to be replayed: what was measured, what was sent, and the start of each window."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.local_fit import local_fit
from residual_mpc.diagnosis.data.noise_model import ChannelNoise
from residual_mpc.diagnosis.data.past_errors import past_errors
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.signals import Signal, Signals
from residual_mpc.diagnosis.data.window_commands import drive_of
from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.logs.signals import continuous, noise_sigma, resolution
from residual_mpc.models.optional import held_joints
from residual_mpc.models.protocol import Drive, Merging, Robot

POSITION_LIKE = ("position", "pose")


@dataclass(frozen=True)
class Block:
    """The windows of the runs that share one robot model (a variant), as rows `where` of the dataset's arrays. group:
    which of `Settings.others` apply to them, counted from 1; 0: the settings themselves. In a comparison, group 1 is
    the later set. own: steps of the user's model in one of the drive's.
    """

    robot: Robot
    where: slice
    drive: Drive
    group: int = 0
    own: int = 1

    @property
    def steps(self) -> int:
        """Of the user's model in one window."""
        return self.drive.steps * self.own


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
    signals: Signals
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

    @property
    def cost(self) -> int:
        """Steps of the user's model that one hypothesis costs on all windows."""
        return sum((b.where.stop - b.where.start) * b.steps for b in self.blocks)

    def take(self, keep: np.ndarray) -> "Dataset":
        """The windows where the mask (W,) is true."""
        blocks, first = [], 0
        for b in self.blocks:
            rows = keep[b.where]
            n = int(rows.sum())
            if n:
                blocks.append(replace(b, where=slice(first, first + n), drive=b.drive.take(rows)))
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
        blocks += [replace(b, where=slice(at + b.where.start, at + b.where.stop)) for b in d.blocks]
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
    *,
    settings: DataSettings = DataSettings(),
) -> Dataset:
    """Cut runs into windows. robots[i] is the model of runs[i] (the same object for runs that share one);
    starts[i] (W,) s: where the windows of runs[i] begin; None: as the gap has them.

    Raises BadInput where no window has a measured start.
    """
    runs = tuple(runs)
    robots, setting = _merge(robots)
    measured = [r.measured for r in runs]
    channels = tuple(sorted({c for cs, m in zip(measured, robots, strict=True) for c in cs if c in m.channels}))
    signals = Signals({(i, c): _signal(r, c) for i, r in enumerate(runs) for c in channels if c in measured[i]})
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
        variants = None if setting is None else [setting[i] for i in mine]
        drive = drive_of(robot, [runs[i] for i in mine], kept, horizon, mine, signals, settings, variants)
        past = past_errors(robot, [runs[i] for i in mine], kept, mine, signals)
        drive = replace(drive, past=past)
        if variants is not None:
            drive = replace(drive, setting=np.repeat(variants, [len(k) for k in kept]))
        blocks.append(Block(robot, slice(first, first + n), drive))
        index += [np.full(len(k), i) for i, k in zip(mine, kept, strict=True)]
        starts += kept
        first += n
    if not first:
        raise BadInput(
            f"none of {skipped} windows has a measured start state",
            "runs",
            "every measured position or pose needs a sample within 0.25 s of its start; run `residual-mpc check`",
        )
    run, start = np.concatenate(index), np.concatenate(starts)
    t, y = _samples(runs, run, start, channels, signals, horizon)
    of_run = [compared_channels(m, channels, held_joints(r)) for m, r in zip(measured, robots, strict=True)]
    compared = np.array([[c in of_run[i] for c in channels] for i in run])
    sigma, steps = _noise(channels, signals, noise, settings=settings)
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


def compared_channels(measured: Sequence[str], channels: Sequence[str], held: Sequence[str] = ()) -> tuple[str, ...]:
    """The position-like channels of a run that are measured; its velocities where it has nothing else. Not those of
    joints that the model holds: they stay where they start, and their wobble would count as a gap."""
    mine = [c for c in channels if c in measured]
    at_rest = {f"{kind}.{joint}" for kind in ("position", "velocity") for joint in held}
    mine = [c for c in mine if c not in at_rest] or mine
    like = [c for c in mine if c.split(".")[0] in POSITION_LIKE]
    return tuple(like or mine)


def _signal(run: Run, channel: str) -> Signal:
    y = continuous(channel, run.columns[channel])
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
    channels: Sequence[str],
    signals: Mapping[tuple[int, str], Signal],
    given: Mapping[str, float],
    settings: DataSettings,
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
        moving = [s for s in mine if _moves(s, step, settings=settings)]
        moves[k] = bool(moving) or c in given
        longest = [] if c in given else sorted(moving or mine, key=lambda s: -len(s.t))[:12]
        found = [x for s in longest if np.isfinite(x := noise_sigma(s.t, s.y))]
        estimate = float(np.median(found)) if found else 0.0
        sigma[k] = max(given.get(c, estimate), step / np.sqrt(12.0), 1e-9)
        steps[k] = step
    for k in map(int, np.flatnonzero(~moves)):
        alike = [sigma[j] for j, c in enumerate(channels) if moves[j] and c.split(".")[0] == channels[k].split(".")[0]]
        sigma[k] = max([sigma[k], *alike])
    return sigma, steps


def _moves(signal: Signal, step: float, settings: DataSettings) -> bool:
    """Whether a channel moves in a run: by more than a few steps, and in more than a few of its samples."""
    changes = np.count_nonzero(np.diff(signal.y))
    return bool(
        np.ptp(signal.y) > settings.dataset.moves_steps * step
        and changes > settings.dataset.moves_share * len(signal.y)
    )
