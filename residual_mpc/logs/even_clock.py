"""An even clock through uneven time stamps."""

from __future__ import annotations

import numpy as np

from residual_mpc.logs.run import FloatArray

PAUSE = 5.0  # periods without a row, after which the clock starts again
REACH = 25  # rows on either side whose stamps tell where the clock is
GAIN = 0.1  # of a stamp's deviation by which the count follows it
AHEAD = 5  # rows that tell a lost row from a late stamp


def even_clock(t: FloatArray, period: float) -> FloatArray:
    """(n,) s: the times of a clock with the given period (s) that runs through the stamps t (n,) s.

    Its ticks are counted from a running estimate and not from the stamp before, so that a late one does not count
    twice; a lost row is a tick without a stamp, by which the following ones are late as well. The mean of the stamps
    less the ticks then tells where the clock is, and follows it where its rate drifts. At the ends of a run and of a
    pause it goes through the stamps.
    """
    tick, pauses = ticks(t, period)
    offset, out = t - period * tick, np.empty(len(t))
    for part in np.split(np.arange(len(t)), pauses):
        out[part] = _running_mean(offset[part], REACH)
    return np.asarray(out + period * tick)


def ticks(t: FloatArray, period: float) -> tuple[FloatArray, np.ndarray]:
    """(n,) ticks of a clock with this period (s) since the first stamp of t (n,) s, and the rows after a pause."""
    pause = PAUSE * period
    stamps = t.tolist()
    clock, out = stamps[0], [0.0]
    for row in range(1, len(stamps)):
        before, stamp = stamps[row - 1], stamps[row]
        if stamp - before > pause:
            out.append(out[-1] + (stamp - before) / period)
            clock = stamp
            continue
        passed = max(round((stamp - clock) / period), 1)
        if passed > 1:
            passed = 1 + _lost(stamps[row : row + AHEAD], clock, period)
        out.append(out[-1] + passed)
        clock += passed * period
        clock += GAIN * (stamp - clock)
    return np.array(out), np.flatnonzero(np.diff(t) > pause) + 1


def _lost(stamps: list[float], clock: float, period: float) -> int:
    """How many ticks were lost since the one at `clock` (s), by the stamps (s) of the next rows: all but one of them
    are late by at least as many, where a stamp that alone is late has followers in time."""
    late, before = list[float](), clock
    for row, stamp in enumerate(stamps):
        if row and stamp - before > PAUSE * period:
            break
        late.append((stamp - clock) / period - 1.0 - row)
        before = stamp
    return max(round(min(late[0], sorted(late)[min(1, len(late) - 1)])), 0)


def _running_mean(values: FloatArray, reach: int) -> FloatArray:
    """(n,) the mean of each value and as many on either side as there are on both, up to `reach`."""
    row = np.arange(len(values))
    total = np.concatenate([[0.0], np.cumsum(values - values[0])])
    half = np.minimum(reach, np.minimum(row, row[::-1]))
    return np.asarray((total[row + half + 1] - total[row - half]) / (2 * half + 1) + values[0])
