"""The half of the runs that a change is put into, with the models that its runs are predicted with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from residual_mpc.blind.recorded.log import FloatArray, Log
from residual_mpc.logs.columns import member


@dataclass(frozen=True)
class Setting:
    """One setting of the robot. runs: pattern of its runs' names; model: MJCF text, empty for plants without one;
    parameters: all nominal values that the robot file states for it."""

    runs: str
    model: str
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Half:
    """Logs of one robot and its settings, the general one first."""

    robot: str
    plant: str
    logs: tuple[Log, ...]
    settings: tuple[Setting, ...]
    payload_site: str | None = None

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that every log has."""
        return tuple(c for c in self.logs[0].columns if all(c in log.columns for log in self.logs))

    @property
    def measured(self) -> tuple[str, ...]:
        """What every log measures, apart from what drives the model."""
        return tuple(c for c in self.columns if all(c in log.measured for log in self.logs))

    @property
    def actuators(self) -> tuple[str, ...]:
        """Actuators to which every log has a command that was sent."""
        return tuple(member(c) for c in self.columns if c.startswith("command."))

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints whose position every log has."""
        return tuple(member(c) for c in self.measured if c.startswith("position."))

    @cached_property
    def seconds(self) -> float:
        """Median length of a run."""
        return float(np.median([np.ptp(next(iter(log.columns.values())).t) for log in self.logs]))

    def spread(self, column: str) -> float:
        """Root mean square of a column about each run's mean."""
        return float(np.sqrt(np.mean([np.nanvar(self._unwrapped(log, column)) for log in self.logs])))

    def speed(self, column: str) -> float:
        """Root mean square rate of change of a column, seen over a twentieth of a second or a sample."""
        squares: list[float] = []
        for log in self.logs:
            t, y = log.columns[column].t, self._unwrapped(log, column)
            t, y = t[np.isfinite(y)], y[np.isfinite(y)]
            ahead = np.maximum(np.searchsorted(t, t + 0.05 - 1e-9), np.arange(len(t)) + 1)
            k = np.flatnonzero(ahead < len(t))
            squares.append(float(np.mean(((y[ahead[k]] - y[k]) / (t[ahead[k]] - t[k])) ** 2)) if len(k) else 0.0)
        return float(np.sqrt(np.mean(squares)))

    def pace(self, columns: tuple[str, ...]) -> float:
        """s, the time in which these columns commonly change by their spread: the shortest among them."""
        times = [self.spread(c) / self.speed(c) for c in columns if self.speed(c) > 0]
        return min(times, default=0.0)

    @staticmethod
    def _unwrapped(log: Log, column: str) -> FloatArray:
        y = log.columns[column].values.copy()
        if column == "pose.theta":
            seen = np.isfinite(y)
            y[seen] = np.unwrap(y[seen])
        return y

    def with_logs(self, change: Callable[[Log], Log]) -> Half:
        """The half with every log changed."""
        return replace(self, logs=tuple(change(log) for log in self.logs))

    def with_models(self, change: Callable[[str], str]) -> Half:
        """The half with every setting's model changed."""
        return replace(self, settings=tuple(replace(s, model=change(s.model)) for s in self.settings))

    def with_parameters(self, change: Callable[[Mapping[str, float]], Mapping[str, float]]) -> Half:
        """The half with every setting's parameters changed."""
        return replace(self, settings=tuple(replace(s, parameters=change(s.parameters)) for s in self.settings))
