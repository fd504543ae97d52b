"""One recorded run of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from residual_mpc.logs.columns import group, is_measured, member

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """One run: a table whose columns carry the names of the log format, whatever the file called them.

    Attributes:
        name: unique among the runs of a call.
        t: (n,) s, strictly increasing, finite, n >= 2; runs that were read count from their first sample.
        columns: recognised columns, each (n,) in the unit of the log format; NaN is a missing sample.
        served_as_command: measured columns of `columns` that also serve as a command and are not compared.
        extra: names of the table's other columns, which nothing here understands.
        extra_columns: those of them that are numeric, each (n,).
        source: the file, for messages.
        start: s, what the log's own clock showed at t = 0.
        incidents: (begin, end) s of stretches that no model explains: a sensor failed, or the robot was off.
    """

    name: str
    t: FloatArray
    columns: Mapping[str, FloatArray]
    served_as_command: frozenset[str] = frozenset()
    extra: tuple[str, ...] = ()
    extra_columns: Mapping[str, FloatArray] = field(default_factory=dict)
    source: str = ""
    start: float = 0.0
    incidents: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        n = len(self.t)
        if n < 2 or not np.all(np.isfinite(self.t)) or not np.all(np.diff(self.t) > 0.0):
            raise ValueError(f"run {self.name}: t must hold at least two finite, strictly increasing time stamps")
        for name, values in {**self.columns, **self.extra_columns}.items():
            if values.shape != (n,):
                raise ValueError(f"run {self.name}: {name} must have shape {(n,)}, got {values.shape}")

    @property
    def actuators(self) -> tuple[str, ...]:
        """The actuators that have a command column, in the table's order."""
        return tuple(member(name) for name in self.columns if group(name) == "command")

    @property
    def measured(self) -> tuple[str, ...]:
        """The measured columns with at least one sample that do not serve as a command."""
        return tuple(
            name
            for name, values in self.columns.items()
            if is_measured(name) and name not in self.served_as_command and bool(np.any(np.isfinite(values)))
        )

    @cached_property
    def sampled(self) -> FloatArray:
        """(m,) s: the stamps of the column that was sampled most often, m >= 2 unless every column has one sample.

        In a plain table these are all rows. Where sensors of different rates share a table, its rows are those of all.
        """
        most, best = -1, self.t
        for values in self.columns.values():
            there = np.isfinite(values)
            if (count := int(there.sum())) > most and count > 1:
                most, best = count, self.t if count == len(there) else self.t[there]
        return best

    @cached_property
    def period(self) -> float:
        """The median time between samples of the column that was sampled most often, s."""
        return float(np.median(np.diff(self.sampled)))


def held(run: Run, column: str) -> FloatArray:
    """A column with each value held until the next that is not missing, (n,); NaN before the first."""
    return hold(run.columns[column])


def hold(values: FloatArray) -> FloatArray:
    """(n,) each value held until the next that is not missing; NaN before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)
