"""The gap as its definition reads, in loops and numpy.polyfit: slow, and shares nothing with the library's own.

The model is a function replay(run, start, t0) -> reading(channel, t); how it integrates is its own affair.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from residual_mpc.logs.run import Run

Reading = Callable[[str, float], float]
Replay = Callable[[Run, Mapping[str, float], float], Reading]
REACH = 0.25  # s


def samples_of(run: Run, channel: str) -> list[tuple[float, float]]:
    """(t, value) of every sample that is not missing; angles and positions without their jumps of 2 pi."""
    out: list[tuple[float, float]] = []
    for t, y in zip(run.t, run.columns[channel], strict=True):
        if math.isnan(y):
            continue
        if out and (channel == "pose.theta" or channel.startswith("position.")):
            while y - out[-1][1] > math.pi:
                y -= 2 * math.pi
            while y - out[-1][1] < -math.pi:
                y += 2 * math.pi
        out.append((float(t), float(y)))
    return out


def local(samples: Sequence[tuple[float, float]], t0: float) -> tuple[float, float | None] | None:
    """Value and slope at t0 of the polynomial through the nearest five; None where no sample is within reach."""
    near = sorted(samples, key=lambda s: abs(s[0] - t0))[:5]
    near = [s for s in near if abs(s[0] - t0) <= REACH]
    if not near:
        return None
    degree = {1: 0, 2: 1}.get(len(near), 2)
    p = np.polyfit([t - t0 for t, _ in near], [y for _, y in near], degree)
    return float(p[-1]), (float(p[-2]) if degree else None)


def window_starts(run: Run, horizon: float) -> list[float]:
    first, last = float(run.t[0]), float(run.t[-1])
    if last - first < horizon:
        return [first]
    period = float(np.median(np.diff(run.t)))
    out: list[float] = []
    while last + period >= first + (len(out) + 1) * horizon - 1e-9:
        out.append(first + len(out) * horizon)
    return out


def position_like(channel: str) -> bool:
    return channel.startswith(("position.", "pose."))


def gap_literal(
    runs: Sequence[Run],
    channels: Sequence[str],
    states: Sequence[tuple[str, str | None]],
    replay: Replay,
    horizon: float,
    sigma: Mapping[str, float],
    step: Mapping[str, float],
) -> dict[str, object]:
    """Gap, its channels, windows, skipped and still.

    channels: what the model predicts; states: (position, velocity) channels of the start state; sigma, step: each
    channel's noise and resolution.
    """
    error: dict[str, list[float]] = {c: [] for c in channels}
    moved: dict[str, list[float]] = {c: [] for c in channels}
    windows = skipped = 0
    for run in runs:
        measured = [c for c in channels if c in run.columns and not np.isnan(run.columns[c]).all()]
        samples = {c: samples_of(run, c) for c in measured}
        compared = [c for c in measured if position_like(c)] or measured
        for t0 in window_starts(run, horizon):
            at = {c: local(samples[c], t0) for c in measured}
            if any(at[c] is None for c in measured if position_like(c)):
                skipped += 1
                continue
            windows += 1
            start: dict[str, float] = {}
            for position, velocity in states:
                here = at.get(position)
                start[position] = 0.0 if here is None else here[0]
                if velocity is not None:
                    rate = at.get(velocity)
                    slope = None if here is None else here[1]
                    start[velocity] = rate[0] if rate is not None else (slope or 0.0)
            reading = replay(run, start, t0)
            for c in compared:
                for t, y in samples[c]:
                    if t0 - 1e-9 <= t < t0 + horizon + 1e-9:
                        error[c].append(y - reading(c, t))
                        begin = at[c]
                        if begin is not None:
                            moved[c].append(y - begin[0])
    size = {c: math.sqrt(sum(m * m for m in moved[c]) / len(moved[c])) for c in channels if moved[c]}
    if "pose.x" in size and "pose.y" in size:
        size["pose.x"] = size["pose.y"] = math.sqrt(size["pose.x"] ** 2 + size["pose.y"] ** 2)
    still = [c for c in size if size[c] < 3 * sigma[c] or size[c] < 3 * step[c]]
    each = {c: math.sqrt(sum(e * e for e in error[c]) / len(error[c])) / size[c] for c in size if c not in still}
    total = math.sqrt(sum(g * g for g in each.values()) / len(each))
    return {"gap": total, "channels": each, "windows": windows, "skipped": skipped, "still": sorted(still)}


def mean_held(run: Run, column: str, a: float, b: float) -> float:
    """Mean over [a, b] of a command, each value held until the next that is not missing; the first before its time."""
    known = [(float(t), float(u)) for t, u in zip(run.t, run.columns[column], strict=True) if not math.isnan(u)]
    total = 0.0
    for i, (t, u) in enumerate(known):
        begin = -math.inf if i == 0 else t
        end = known[i + 1][0] if i + 1 < len(known) else math.inf
        total += u * max(0.0, min(b, end) - max(a, begin))
    return total / (b - a)
