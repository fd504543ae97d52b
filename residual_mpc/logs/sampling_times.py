"""When samples were taken, where the stamps vary and the samples do not.

A driver that samples on a timer and a program that stamps what arrives leave an even series of samples under uneven
stamps: a moving joint then seems to jump by its speed times the error of each stamp. Other loops do sample unevenly,
and their stamps say when. The samples themselves tell the two apart: at the right times each lies on the cubic through
its four neighbours. In between, both vary, and the best guess of a sample's time is an even clock plus the share of the
stamp's deviation that belongs to the sampling.

A joint that follows its command at once shows the position commanded at the previous stamp. Its samples lie on a smooth
curve over the stamps of the previous rows, and the stamps are right. Speeds may follow a held command within a sample
as well, and then look smoother over the rows than over time, so they are used only if no position has enough samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.logs.columns import group
from residual_mpc.logs.even_clock import PAUSE, even_clock
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.logs.signals import continuous, fresh_samples

STEADY = 0.02  # of the period: stamps that vary by less are as good as even
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a stamp's deviation that may be the sampling's; the last: as logged
FAR = 2.5  # periods between neighbours, above which no cubic is laid through them
WHOLE = 0.6  # share of the rows that a channel must have been sampled in; those that repeat the last one say nothing
FEWEST, MOST = 100, 2_000_000  # rows
ROWS = 20_000  # rows of a channel that are looked at, at most
FASTEST = 0.5  # share of them, by speed, in which errors of the stamps show
USUAL = 0.95  # share of them that are no outliers
TOGETHER = 4  # rows that count as one, since neighbours share their cubics
PLACES = ("pose", "position")
EVIDENCE = 10.0  # log-likelihood by which some times must be better than others
LESS = 0.8  # of the mean square error: what one channel must fall below, for the times to be worth a change


@dataclass(frozen=True, eq=False)
class StampTest:
    """What the samples of a run say of their stamps.

    Attributes:
        even: (n,) s, the even clock.
        spread: s, 1-sigma of the stamps about it.
        likelihood: (S,) log-likelihood of each of SHARES, less that of the stamps as logged.
        error: (S,) mean square error of the cubics over that at the stamps as logged, of the channel where it falls
            most.
        before: log-likelihood of the stamps of the previous rows, less that of the stamps as logged.
    """

    even: FloatArray
    spread: float
    likelihood: FloatArray
    error: FloatArray
    before: float

    @property
    def sampling(self) -> float | None:
        """The share of the stamps' deviation that is the sampling's; None where the run alone does not tell."""
        best = int(self.likelihood.argmax())
        if self.before > max(self.likelihood[best], EVIDENCE):
            return 1.0
        if SHARES[best] == 1.0:
            return 1.0 if self.likelihood[:-1].max() < -EVIDENCE else None
        return SHARES[best] if self.likelihood[best] > EVIDENCE and self.error[best] < LESS else None


def with_sampling_times(runs: Sequence[Run]) -> tuple[tuple[Run, ...], tuple[Finding, ...]]:
    """The runs on the times at which their samples were taken, as far as the samples tell, and what was changed.

    A run that does not tell by itself follows the others, where none of them was sampled as it was stamped.
    """
    tests = [_test(run) for run in runs]
    told = [None if test is None else test.sampling for test in tests]
    sure = [test for test, share in zip(tests, told, strict=True) if test is not None and share is not None]
    together = None
    if sure and 1.0 not in told:
        together = SHARES[int(np.sum([test.likelihood for test in sure], axis=0).argmax())]
    out, changed = [], []
    for run, test, own in zip(runs, tests, told, strict=True):
        share = together if own is None else own
        t = run.t if test is None or share is None else test.even + share * (run.t - test.even)
        if test is None or share in (None, 1.0) or not (np.diff(t) > 0.0).all():
            out.append(run)
            continue
        out.append(replace(run, t=t))
        changed.append((run, test, float(share)))
    return tuple(out), (_finding(changed, len(runs)),) if changed else ()


def _finding(changed: Sequence[tuple[Run, StampTest, float]], count: int) -> Finding:
    """What was changed, of how many runs."""
    run, spread = max(((run, test.spread) for run, test, _ in changed), key=lambda x: x[1])
    smoother = max(1.0 / np.sqrt(test.error[SHARES.index(share)]) for _, test, share in changed)
    share = max(share for *_, share in changed)
    several = len(changed) > 1
    most, where = ("up to ", f"in {len(changed)} of {count} runs ") if several else ("", "")
    clock = f"an even clock with {most}{share:.0%} of this variation" if share else "an even clock"
    text = (
        f"{where}the time stamps vary by {most}{1e3 * spread:.2g} ms ({spread / run.period:.0%} of the sampling"
        f" period), and the measured motion is {most}{smoother:.2g} times as smooth on {clock}, which replaces them"
    )
    remedy = "write the time at which a sample is taken, not the time at which it arrives"
    return Finding("warning", "uneven stamps", "" if several else run.name, "t", None, text, remedy)


def _test(run: Run) -> StampTest | None:
    """None where the stamps are as good as even, or the run has too few samples that move."""
    t = run.t
    if not FEWEST <= len(t) <= MOST:
        return None
    step = np.diff(t)
    period = float(np.median(step))
    usual = step[step < PAUSE * period]
    if float(np.mean(np.abs(usual - period))) < STEADY * period:
        return None
    fresh = {c: fresh_samples(run.columns[c]) for c in run.measured}
    channels = {c: np.where(new, run.columns[c], np.nan) for c, new in fresh.items() if np.mean(new) > WHOLE}
    places = {c: y for c, y in channels.items() if group(c) in PLACES}
    channels = places or channels
    even = even_clock(t, period)
    spread = float(np.sqrt(np.mean((t - even) ** 2)))
    if spread < STEADY * period or not channels:
        return None
    of_before = even + np.concatenate([[0.0], (t - even)[:-1]])
    shares = [even + share * (t - even) for share in SHARES]
    sizes, counts = cubic_errors([of_before, *shares], channels, FAR * period)
    if not len(sizes):
        return None
    likelihood = -0.5 / TOGETHER * (counts[:, None] * np.log(sizes)).sum(axis=0)
    before, *likelihood = likelihood - likelihood[-1]
    error = (sizes[:, 1:] / sizes[:, -1:]).min(axis=0)
    return StampTest(even, spread, np.array(likelihood), error, float(before))


def cubic_errors(
    candidates: Sequence[FloatArray], channels: Mapping[str, FloatArray], far: float
) -> tuple[FloatArray, FloatArray]:
    """(C, S) mean squares by which samples lie off the cubic through their neighbours, at each of the candidate times
    (n,) s, and from how many (C,): of the channels (n,) that move. far: s between neighbours on the last candidate,
    above which there is no cubic."""
    close = np.diff(candidates[-1]) < far
    whole = np.flatnonzero(close[:-3] & close[1:-2] & close[2:-1] & close[3:]) + 2
    sizes, counts = [], []
    for name, values in channels.items():
        y = continuous(name, values)
        rows = whole[np.isfinite([y[whole + k] for k in range(-2, 3)]).all(axis=0)]
        rows = rows[:: max(len(rows) // ROWS, 1)]
        if len(rows) < FEWEST:
            continue
        speed = np.abs(y[rows + 2] - y[rows - 2])
        rows = rows[(speed > 0.0) & (speed >= np.quantile(speed, 1.0 - FASTEST))]
        if len(rows) < FEWEST:
            continue
        square = np.stack([_off_the_cubic(t, y, rows) ** 2 for t in candidates])  # (S, rows)
        usual = np.sort(square, axis=1)[:, : int(USUAL * len(rows))].mean(axis=1)
        if usual[-1] > 0.0:
            sizes.append(np.maximum(usual, 1e-12 * usual[-1]))
            counts.append(len(rows))
    return np.array(sizes), np.array(counts, dtype=float)


def _off_the_cubic(t: FloatArray, y: FloatArray, rows: np.ndarray) -> FloatArray:
    """(r,) y at the rows (r,) less the cubic through two samples on either side, over the noise that both pass on."""
    near = np.stack([t[rows + k] - t[rows] for k in (-2, -1, 1, 2)])
    weights = np.ones_like(near)
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= near[j] / (near[j] - near[i])
    cubic = sum(weights[i] * y[rows + k] for i, k in enumerate((-2, -1, 1, 2)))
    return np.asarray((y[rows] - cubic) / np.sqrt(1.0 + (weights**2).sum(axis=0)))
