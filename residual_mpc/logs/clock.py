"""The clock of a run: seconds or nanoseconds since whenever, counted from the run's own start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from residual_mpc.logs.run import FloatArray

IntArray = NDArray[np.int64]

SINCE_1970 = (9.0e8, 2.6e9)  # s since 1970 in the years 1998 to 2052
LEAST, MOST = 1e5, 2e9  # between rows: no log in s has so much, and one in ns at 0.5 Hz to 10 kHz has


@dataclass(frozen=True)
class Stamps:
    """The time stamps of a run's rows.

    Attributes:
        t: (m,) s since the earliest of them; NaN where a row has none.
        start: s, the earliest as the log counts.
        unit: of the log.
    """

    t: FloatArray
    start: float
    unit: Literal["s", "ns"]

    def logged(self, t: float) -> str:
        """A time as the log counts, in s, to the microsecond."""
        return f"{self.start + t:.15g}"


def count_from_start(values: FloatArray, whole: IntArray | None, unit: Literal["s", "ns"] | None = None) -> Stamps:
    """The stamps of a run, counted from its earliest.

    Nanoseconds since 1970 need 61 bits and a float has 53, so that whole numbers are subtracted as such.

    Args:
        values: (m,) as the log has them; NaN is missing.
        whole: (m,) the same as whole numbers, where the column holds nothing else.
        unit: where it is known; else it is told by the values.
    """
    there = np.isfinite(values)
    if not there.any():
        return Stamps(values, 0.0, "s")
    first = int(np.nanargmin(values))
    if whole is not None:
        first = int(np.flatnonzero(there)[np.argmin(whole[there])])
    since = values - values[first] if whole is None else np.where(there, whole - whole[first], np.nan)
    start = float(values[first])
    if unit == "ns" or unit is None and _in_nanoseconds(start, since[there]):
        return Stamps(since / 1e9, start / 1e9, "ns")
    return Stamps(since, start, "s")


def _in_nanoseconds(start: float, since: FloatArray) -> bool:
    """Whether stamps, (m,) since `start`, count nanoseconds."""
    year = {unit: SINCE_1970[0] < start * unit < SINCE_1970[1] for unit in (1e-9, 1e-6, 1e-3)}
    steps = np.diff(np.sort(since))
    steps = steps[steps > 0.0]
    if not steps.size:
        return False
    return year[1e-9] or not any(year.values()) and LEAST <= float(np.median(steps)) < MOST
