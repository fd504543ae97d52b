"""A rover whose residuals are linear in its free numbers, so that what a fit should say of them is known exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from oracles.rover_log import SIGMA

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Values

ROVER = DiffDrive("rover", 0.033, 0.16)
SCALE, GAIN = Knob("track_width", None, "scale"), Knob("actuator_gain", None, "gain")
WIDTH, HEADING, RATE = Knob("dead_zone", None, "width"), Knob("slope", None, "heading"), Knob("slope", None, "rate")


def driven(name: str, seconds: float, seed: int = 0) -> Run:
    """A log with a sample every 0.1 s whose pose wanders at random: for what needs windows, but no robot."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(round(seconds / 0.1) + 1)
    columns = {f"command.{wheel}": 5.0 * np.sin(t + phase) for wheel, phase in (("left", 0.0), ("right", 1.0))}
    columns |= {c: np.cumsum(0.1 * rng.standard_normal(len(t))) for c in SIGMA}
    return Run(name, t, columns)


def windows(runs: int, seconds: float) -> Dataset:
    return build_dataset([driven(f"r{k}", seconds, k) for k in range(runs)], [ROVER] * runs, SIGMA)


@dataclass
class Linear:
    """Residuals (H, W, n) = noise + sum over the knobs of column * (value - truth), noise and columns (W, n)."""

    data: Dataset
    space: Space
    columns: Mapping[Knob, np.ndarray]
    truth: Values
    noise: np.ndarray

    def residuals(self, hypotheses: Sequence[Values]) -> np.ndarray:
        moved = [sum(self.columns[k] * (v - self.truth[k]) for k, v in h.items()) for h in hypotheses]
        return np.asarray(self.noise + np.array(moved))


def white(data: Dataset, rng: np.random.Generator, samples: int = 30) -> np.ndarray:
    """(W, n) noise of unit size."""
    return np.asarray(rng.standard_normal((data.count, samples)))


def coloured(data: Dataset, column: np.ndarray, size: float, rng: np.random.Generator) -> np.ndarray:
    """White noise plus, in each stretch of time, a push of its own along one column (W, n)."""
    blocks = blocks_of(data, FitSettings())
    return white(data, rng, column.shape[1]) + size * rng.standard_normal(blocks.max() + 1)[blocks, None] * column


def explained(problem: Any, fit: Fit, **others: Any) -> Any:
    """A fit as the explanation that `causes_of` describes."""
    rivalry = SimpleNamespace(shares={}, rivals=())
    raw = SimpleNamespace(channels=("pose.x",), compared=np.array([[True]]))
    usual = {"tolerated": None, "omitted": (), "ends": {}, "rivalry": rivalry, "with_outliers": False}
    usual |= {"space": problem.space, "raw": raw, "run_sizes": {}, "in_parts": {}}
    return SimpleNamespace(problem=problem, final=fit, **{**usual, **others})


def fitted(problem: Any, start: Values) -> Fit:
    return fit_all(problem, [start], 24, 1e-9)[0]


def space_of(data: Dataset) -> Space:
    return build_space(data, ())
