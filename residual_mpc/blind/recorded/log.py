"""A recorded run as columns that each have stamps of their own, so that a clock can be moved without resampling."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from residual_mpc.logs.columns import group, is_measured
from residual_mpc.logs.run import Run

FloatArray = NDArray[np.float64]
SNAP = 0.02  # of the sampling period: stamps that are nearer to each other share a row


@dataclass(frozen=True)
class Column:
    """t: (n,) s, increasing; values: (n,) in the unit of the log format, NaN where a sample is missing."""

    t: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class Log:
    """One run. columns: by their names in the log format; driving: measured columns that serve as commands."""

    name: str
    columns: Mapping[str, Column]
    driving: frozenset[str] = frozenset()

    @property
    def measured(self) -> tuple[str, ...]:
        """What sensors reported and what does not drive the model."""
        return tuple(c for c in self.columns if is_measured(c) and c not in self.driving)

    @property
    def commands(self) -> tuple[str, ...]:
        """The columns that drive the model."""
        return tuple(c for c in self.columns if group(c) == "command" or c in self.driving)

    def with_values(self, names: Iterable[str], change: Callable[[FloatArray], FloatArray]) -> Log:
        """The log with ``change`` applied to the values of some columns."""
        return self._with(names, lambda c: replace(c, values=change(c.values)))

    def with_stamps(self, names: Iterable[str], change: Callable[[FloatArray], FloatArray]) -> Log:
        """The log with ``change`` applied to the stamps of some columns."""
        return self._with(names, lambda c: replace(c, t=change(c.t)))

    def _with(self, names: Iterable[str], change: Callable[[Column], Column]) -> Log:
        return replace(self, columns={**self.columns, **{n: change(self.columns[n]) for n in names}})


def log_of(run: Run, name: str, aliases: Mapping[str, str]) -> Log:
    """``run`` under another name. aliases: command column -> the measured column that it is, written once."""
    columns = {c: Column(run.t, values) for c, values in run.columns.items() if c not in aliases}
    return Log(name, columns, run.served_as_command)


def table_of(log: Log) -> dict[str, FloatArray]:
    """``t`` and the columns on one set of rows; a column has NaN in rows that are not its own.

    Stamps within 2 % of the sampling period share a row, under the earliest of them; no value is interpolated.
    """
    clocks = {id(c.t): c.t for c in log.columns.values()}
    if len(clocks) == 1:
        return {"t": next(iter(clocks.values())), **{n: c.values for n, c in log.columns.items()}}
    steps = [np.diff(t) for t in clocks.values()]
    near = min(SNAP * float(np.median(steps[0])), *(0.4 * float(s.min()) for s in steps))
    every = np.unique(np.concatenate(list(clocks.values())))
    rows = [every[0]]
    for t in every[1:].tolist():
        if t - rows[-1] > near:
            rows.append(t)
    stamps = np.array(rows)
    places = {key: np.searchsorted(stamps, t, side="right") - 1 for key, t in clocks.items()}
    table = {"t": stamps}
    for name, column in log.columns.items():
        values = np.full(len(stamps), np.nan)
        values[places[id(column.t)]] = column.values
        table[name] = values
    return table


def period_of(logs: Iterable[Log]) -> tuple[float, bool]:
    """Median sampling period over the logs, s, and whether nine intervals in ten are within 2 % of it."""
    steps = np.concatenate([np.diff(next(iter(log.columns.values())).t) for log in logs])
    period = float(np.median(steps))
    return period, bool(np.mean(np.abs(steps - period) < SNAP * period) >= 0.9)
