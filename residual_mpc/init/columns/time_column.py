"""Which column is the time, and in which unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.guess import Guess, LogCorrection
from residual_mpc.init.columns.recording import Recording
from residual_mpc.init.columns.words import TIME_WORDS, tokens
from residual_mpc.logs.clock import count_from_start
from residual_mpc.logs.run import FloatArray

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # s
SAID = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanosec", "nanoseconds"), "ns"),
}
FAVOURITES = {"t": 6.0, "time": 5.0, "timestamp": 5.0, "stamp": 4.5}
COUNTERS = frozenset("index idx frame frames row rows seq sequence step steps counter unnamed id sample".split())
BACKWARDS = 0.01  # share of the rows that may run backwards
ENOUGH = 2.0  # score from which a column counts as a time
USUAL, SPREAD = 0.015, math.log(6.0)  # s between samples, and how far logs lie from it
EPOCH = (9.0e8, 2.5e9)  # s since 1970 of the years 1998 to 2049


@dataclass(frozen=True)
class Clock:
    """The column of the time and the length of its unit in s; what was guessed of it."""

    column: str
    unit: float
    guesses: tuple[Guess, ...]
    mends: tuple[LogCorrection, ...]


def find_clock(recordings: Sequence[Recording]) -> Clock:
    """The time of the recordings.

    Raises BadInput where no column can be one.
    """
    shared = [n for n in recordings[0].columns if all(n in r.columns for r in recordings)]
    scores = {name: _score(name, [r.columns[name] for r in recordings]) for name in shared}
    ranked = sorted(scores, key=lambda name: -scores[name])
    if not ranked or scores[ranked[0]] < ENOUGH:
        listed = ", ".join(shared[:30]) + (", ..." if len(shared) > 30 else "")
        raise BadInput(
            f"no time column was found: none increases and has a name like a time; the columns are {listed}",
            str(recordings[0].source),
            "log the time of each row in seconds in a column t",
        )
    best = ranked[0]
    # the same clock in two units, or counted from another zero, is no rival that matters
    rivals = tuple(n for n in ranked[1:] if scores[n] > scores[best] - 1.5 and not _same(recordings, best, n))
    unit, reason, sure = _unit(best, recordings)
    why = "its name, and it increases with every row" if _named(best) else "the only column that increases evenly"
    guesses = [
        Guess("t", best, why, 0.6 if rivals else 0.98 if _named(best) else 0.6, rivals),
        Guess(f"unit of {best}", unit, reason, sure),
    ]
    mends: list[LogCorrection] = []
    if unit != "s" and not (unit == "ns" and _read_as_nanoseconds(best, recordings)):
        mends.append(LogCorrection(best, UNITS[unit], 0.0, f"times must be in s, got {unit}: {reason}", sure))
    return Clock(best, UNITS[unit], tuple(guesses), tuple(mends))


def seconds(clock: Clock, recording: Recording) -> FloatArray:
    """(n,) s from the first stamp, NaN where one is missing."""
    raw = recording.columns[clock.column]
    return np.asarray((raw - np.nanmin(raw)) * clock.unit)


def _read_as_nanoseconds(name: str, recordings: Sequence[Recording]) -> bool:
    """Whether a column needs no mending, since every command reads it as nanoseconds by itself, or as dates."""
    return all(
        r.unit == "ns" or name in r.dates or count_from_start(r.columns[name], None).unit == "ns" for r in recordings
    )


def _named(name: str) -> bool:
    return bool(set(tokens(name)) & TIME_WORDS)


def _score(name: str, values: Sequence[FloatArray]) -> float:
    """How much like a time: by its name, and by how it goes on; -inf where it cannot be one."""
    steps = np.concatenate([np.diff(v[np.isfinite(v)]) for v in values])
    rows = sum(len(v) for v in values)
    if len(steps) < 0.9 * rows - len(values) or not len(steps) or not (steps > 0).any():
        return -math.inf
    if (steps < 0).sum() > max(1.0, BACKWARDS * rows):
        return -math.inf
    words = tokens(name)
    score = FAVOURITES.get(name, 3.0 if _named(name) else 0.0)
    usual = float(np.median(steps))
    even = usual > 0 and np.median(np.abs(steps - usual)) < 0.3 * usual
    score += 2.0 if even else 0.0 if (steps > 0).mean() > 0.5 else -2.0
    if set(words) & COUNTERS or not _named(name) and np.all(steps == steps[0]) and steps[0] == 1.0:
        score -= 4.0
    return score + (0.5 if (steps > 0).all() else 0.0)


def _same(recordings: Sequence[Recording], one: str, other: str) -> bool:
    """Whether two columns tell the same time, up to unit and zero."""
    for r in recordings:
        a, b = r.columns[one], r.columns[other]
        both = np.isfinite(a) & np.isfinite(b)
        if both.sum() < 3 or np.ptp(a[both]) == 0.0:
            continue
        x, y = a[both] - a[both][0], b[both] - b[both][0]
        slope = float(x @ y / (x @ x))
        if np.abs(y - slope * x).max() > 1e-3 * max(np.abs(y).max(), 1e-300):
            return False
    return True


def _unit(name: str, recordings: Sequence[Recording]) -> tuple[str, str, float]:
    """(unit, reason, how sure)."""
    if any(name in r.dates for r in recordings):
        return "ns", "the column holds dates", 1.0
    fixed = next((r.unit for r in recordings if r.unit is not None and name == "t"), None)
    if fixed is not None:
        return fixed, "recordings count so", 1.0
    raw = [r.columns[name][np.isfinite(r.columns[name])] for r in recordings]
    steps = np.concatenate([np.diff(v) for v in raw])
    period = float(np.median(steps[steps > 0]))
    start = float(min(v.min() for v in raw))
    scores = {u: -0.5 * (math.log(period * f / USUAL) / SPREAD) ** 2 for u, f in UNITS.items()}
    scores["s"] += 1.0
    epoch = next((u for u, f in UNITS.items() if EPOCH[0] < start * f < EPOCH[1]), None)
    if epoch is not None:
        scores[epoch] += 5.0
    said = next((SAID[w] for w in reversed(tokens(name)) if w in SAID), None)
    if said is not None and name != "s":
        scores[said] += 4.0
    best = max(scores, key=lambda u: scores[u])
    weights = {u: math.exp(s - scores[best]) for u, s in scores.items()}
    sure = min(0.99, 1.0 / sum(weights.values()))
    reasons = [f"the sampling period is then {period * UNITS[best]:.3g} s"]
    if epoch == best:
        reasons.append("counted from 1970")
    if said == best:
        reasons.append("the name says so")
    return best, ", ".join(reasons), sure
