"""Time stamps as they came, brought into strictly increasing order where that is beyond doubt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from residual_mpc.errors import BadInput
from residual_mpc.logs.clock import Stamps
from residual_mpc.logs.finding import rows_were
from residual_mpc.logs.run import FloatArray

DISORDER = 0.01  # share of rows out of order up to which they are sorted
CLASHES = 0.2  # share of rows that may repeat a stamp with other values before the stamps count as too coarse
LONGEST, SHORTEST = 2.0, 1e-5  # s: periods beyond these are another unit of time


@dataclass(frozen=True)
class Order:
    """How the rows of a run become its samples.

    Attributes:
        t: (n,) s, strictly increasing from 0.
        rows: (m,) rows that have a stamp, sorted by it, m >= n.
        first: (n,) where in `rows` each sample begins; rows of one stamp form one sample.
        warnings: what was mended, as (kind, message).
    """

    t: FloatArray
    rows: NDArray[np.intp]
    first: NDArray[np.intp]
    warnings: tuple[tuple[str, str], ...]

    def apply(self, values: FloatArray) -> FloatArray:
        """A column in this order, (n,): of the rows of one stamp, the first value that is not missing."""
        sorted_values = values[self.rows]
        merged = sorted_values[self.first].copy()
        count = np.diff(np.append(self.first, len(self.rows)))
        for k in range(1, int(count.max())):
            more = np.flatnonzero((count > k) & np.isnan(merged))
            merged[more] = sorted_values[self.first[more] + k]
        return merged

    def clashes(self, values: FloatArray) -> NDArray[np.bool_]:
        """(m,) the rows whose value differs from the one that `apply` keeps for their stamp."""
        sample = np.cumsum(np.isin(np.arange(len(self.rows)), self.first)) - 1
        sorted_values = values[self.rows]
        return np.isfinite(sorted_values) & (sorted_values != self.apply(values)[sample])


def order_rows(stamps: Stamps, where: str, apart: str = "a column 'run'", joined: bool = False) -> Order:
    """Drop rows without a stamp, sort the few that are out of order, and gather those of one stamp.

    Args:
        stamps: of m rows, as they came.
        where: the run, for messages.
        apart: what would tell several runs of a table apart, for messages.
        joined: whether the rows are those of several topics, in a known unit: two of them may be as close as can be.

    Raises:
        BadInput: fewer than two stamps, stamps that run backwards or start again, or are not in seconds.
    """
    rows = np.flatnonzero(np.isfinite(stamps.t))
    warnings = []
    if len(rows) < len(stamps.t):
        missing = len(stamps.t) - len(rows)
        warnings.append(("missing stamps", f"{rows_were(missing, 'without a time stamp')} dropped"))
    t = stamps.t[rows]
    if len(np.unique(t)) < 2:
        raise BadInput(
            f"the run must have at least two different time stamps, got {'one' if len(t) else 'none'}",
            where,
            "leave the run out, or check the columns 't' and 'run'",
        )
    late = _out_of_order(t)
    if late.size:
        t, rows = _sorted(stamps, rows, late, where, apart)
        warnings.append(("stamps out of order", f"{rows_were(late.size)} out of order, and all are sorted now"))
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > 0.0)
    t = t[first]
    if not joined:
        _check_unit(t, where)
    return Order(t, rows, first, tuple(warnings))


def _out_of_order(t: FloatArray) -> NDArray[np.intp]:
    """The rows that came too late or, where those are fewer, the rows that came too early."""
    late = np.flatnonzero(t < np.maximum.accumulate(t))
    early = np.flatnonzero(t > np.minimum.accumulate(t[::-1])[::-1])
    return late if len(late) <= len(early) else early


def _sorted(
    stamps: Stamps, rows: NDArray[np.intp], late: NDArray[np.intp], where: str, apart: str
) -> tuple[FloatArray, NDArray[np.intp]]:
    t = stamps.t[rows]
    order = np.argsort(t, kind="stable")
    clash = np.isin(t[late], np.delete(t, late)).any() or len(np.unique(t[late])) < late.size
    if late.size > max(1.0, DISORDER * len(t)) or clash:
        k = int(np.flatnonzero(np.diff(t) < 0.0)[0]) + 1
        raise BadInput(
            f"data row {rows[k] + 1} has t = {stamps.logged(t[k])} s, the row before it {stamps.logged(t[k - 1])} s;"
            f" {late.size} of {len(t)} rows are out of order",
            where,
            f"if the table holds several runs, distinguish them by {apart}; otherwise sort it by 't'",
        )
    return t[order], rows[order]


def _check_unit(t: FloatArray, where: str) -> None:
    period = float(np.median(np.diff(t)))
    # rows of sensors that report almost together, as in a corrected bag, have a short median and a usual mean
    if SHORTEST <= period < LONGEST or period < SHORTEST <= (t[-1] - t[0]) / (len(t) - 1):
        return
    if period >= LONGEST:
        factor, unit = next(p for p in ((1e9, "ns"), (1e6, "us"), (1e3, "ms")) if period >= 1e-3 * p[0])
        raise BadInput(
            f"the median time between rows must be below {LONGEST:g} s, got {period:g} s; 't' appears to be in {unit}",
            where,
            f"divide 't' by {factor:g}; a log that really is this slow cannot be compared with a model",
        )
    raise BadInput(
        f"the median time between rows must be at least {SHORTEST:g} s, got {period:g} s",
        where,
        "write 't' in seconds",
    )
