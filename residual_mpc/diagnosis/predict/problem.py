"""The residual that hypotheses are judged by: scaled by noise, with each window's uncertain start state taken out.

A window's start comes from five noisy samples. Its error moves the whole prediction, so the residuals of a window have
covariance R + A P0 A' (A: sensitivity to the start, P0: its covariance), and r is multiplied by that matrix'
inverse square
root: generalised least squares with the start as a nuisance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.local_fit import local_fit
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.replay import memory_of, predict_moved
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.predict.step_lengths import with_longer_steps
from residual_mpc.diagnosis.predict.tolerances import Tolerances
from residual_mpc.models.sensing import sensor_value
from residual_mpc.models.settings import Settings, Values


@dataclass(frozen=True)
class Problem:
    """data: the windows judged; space: the hypotheses; sensitivity (W, M * C, k): prediction moved by one sigma of
    each start coordinate, channel units; weight (C,) 1 / standard deviation of each channel's residual; motion (C,) the
    size of each channel's motion, channel units, infinite where the gap does not compare it; replays: the
    predictions on these windows, which know what was asked before."""

    data: Dataset
    space: Space
    replays: PredictionCache
    sensitivity: np.ndarray
    weight: np.ndarray
    motion: np.ndarray
    basis: np.ndarray  # (W, M * C, k) orthonormal
    shrink: np.ndarray  # (W, k) 1 - 1 / sqrt(1 + s^2)
    count: np.ndarray | None = None  # (W,) how many windows each one stands for; None: itself alone
    tolerances: Tolerances | None = None

    @cached_property
    def marginal(self) -> tuple[np.ndarray, np.ndarray] | None:
        """wide (W * M * C, K), the whitened columns of the tolerances times their level, and taken (K, K): wide @ taken
        @ wide' is what they take out of a residual. None where there are none."""
        if self.tolerances is None or self.tolerances.level == 0.0:
            return None
        wide = self.tolerances.relative * whitened(self, self.tolerances.columns)
        g, v = np.linalg.eigh(wide.T @ wide)
        g = np.maximum(g, 1e-12)
        return wide, (v * ((1.0 - 1.0 / np.sqrt(1.0 + g)) / g)) @ v.T

    def __getstate__(self) -> dict[str, Any]:
        """Without what is made again from the rest."""
        return {k: v for k, v in self.__dict__.items() if k != "marginal"}

    def residuals(self, hypotheses: Sequence[Values]) -> np.ndarray:
        """(H, W, M * C) whitened; a missing sample is 0, a diverged prediction inf."""
        return self.whiten(self.replays(hypotheses))

    def whiten(self, predicted: np.ndarray) -> np.ndarray:
        """As `residuals`, from predictions (H, W, M, C)."""
        y = self.data.y
        r = y - predicted
        r *= self.weight
        r[:, ~np.isfinite(y)] = 0.0
        r[np.isnan(r)] = 1e3
        return self.project(np.clip(r, -1e4, 1e4, out=r).reshape(*r.shape[:2], -1))

    def project(self, r: np.ndarray) -> np.ndarray:
        """Take the start's share out of scaled residuals (H, W, n)."""
        along = np.einsum("wnk,hwn->hwk", self.basis, r, optimize=True) * self.shrink
        left = np.einsum("wnk,hwk->hwn", self.basis, along, optimize=True)
        left = np.subtract(r, left, out=left)
        if self.count is not None:
            left *= np.sqrt(self.count)[:, None]
        if self.marginal is None:
            return left
        (wide, taken), flat = self.marginal, left.reshape(len(left), -1)
        return np.asarray((flat - ((flat @ wide) @ taken) @ wide.T).reshape(left.shape))


def build_problem(
    data: Dataset,
    space: Space,
    sigma: np.ndarray,
    motion: np.ndarray | None = None,
    own: Dataset | None = None,
    times: int = 1,
    *,
    settings: PredictSettings = PredictSettings(),
) -> Problem:
    """sigma (C,): standard deviation of each channel's residual, noise or larger where the model cannot do better;
    motion (C,): see Problem; None for a problem that no search ranks by. own: see PredictionCache. times: factor
    on the model's step that is accurate enough for differences of predictions, such as the sensitivity to the start."""
    size = np.full(len(sigma), np.inf) if motion is None else motion
    replays = PredictionCache(data, space, own=own)
    quick = data if times == 1 else with_longer_steps(data, times) or data
    return weighed(replays, start_sensitivity(quick, space, {}, settings=settings), sigma, size)


def about(problem: Problem, values: Values, settings: PredictSettings) -> Problem:
    """The problem with predictions that are those of the user's model at these values, where its steps are longer."""
    replays = problem.replays.about(values, problem.motion, settings.longer_steps)
    return problem if replays is problem.replays else replace(problem, data=replays.data, replays=replays)


def times_longer(problem: Problem) -> int:
    """The problem's step as a multiple of the user model's step."""
    return max(b.own for b in problem.data.blocks)


def reweigh(problem: Problem, sigma: np.ndarray) -> Problem:
    """The same problem with other standard deviations, without tolerances."""
    return weighed(problem.replays, problem.sensitivity, sigma, problem.motion)


def tolerating(problem: Problem, tolerances: Tolerances | None) -> Problem:
    """The problem with these small differences marginalised."""
    return replace(problem, tolerances=tolerances)


def whitened(problem: Problem, columns: np.ndarray) -> np.ndarray:
    """(W * M * C, K) columns (W, M * C, K) in the units of the problem's residuals, without its tolerances."""
    scaled = np.moveaxis(columns, 2, 0) * np.tile(problem.weight, columns.shape[1] // len(problem.weight))
    return np.ascontiguousarray(replace(problem, tolerances=None).project(scaled).reshape(len(scaled), -1).T)


def weighed(replays: PredictionCache, sensitivity: np.ndarray, sigma: np.ndarray, motion: np.ndarray) -> Problem:
    """The problem on the windows of `replays`."""
    weight = 1.0 / sigma
    w, n, k = sensitivity.shape
    scaled = sensitivity.reshape(w, -1, len(sigma), k) * weight[None, None, :, None]
    basis, s, _ = np.linalg.svd(scaled.reshape(w, n, k), full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + s**2)
    return Problem(replays.data, replays.space, replays, sensitivity, weight, motion, basis, shrink)


def part_of(problem: Problem, keep: np.ndarray, times: np.ndarray | None = None) -> Problem:
    """The problem on the windows where the mask (W,) is true, with the same weights; `times`: how many windows of the
    problem each one that is kept stands for (None: itself alone)."""
    replays = problem.replays.of(problem.data.take(keep), keep)
    small = weighed(replays, problem.sensitivity[keep], 1.0 / problem.weight, problem.motion)
    if problem.count is None and times is None:
        return tolerating(small, on_part(problem, keep))
    one = np.ones(small.data.count)
    count = (one if problem.count is None else problem.count[keep]) * (one if times is None else times)
    return tolerating(replace(small, count=count), on_part(problem, keep))


def on_part(problem: Problem, keep: np.ndarray, samples: int | None = None) -> Tolerances | None:
    """The problem's tolerances on some of its windows, and on their first samples."""
    if problem.tolerances is None:
        return None
    columns = problem.tolerances.columns[keep]
    c = len(problem.weight)
    return replace(problem.tolerances, columns=columns if samples is None else columns[:, : samples * c])


def wider_start(problem: Problem, values: Values, settings: PredictSettings) -> Problem:
    """The problem with the start's uncertainty under these values, where a low-pass of the readings widens it."""
    sensitivity = start_sensitivity(problem.data, problem.space, values, settings)
    wide = weighed(problem.replays, sensitivity, 1.0 / problem.weight, problem.motion)
    return tolerating(replace(wide, count=problem.count), problem.tolerances)


def start_sensitivity(data: Dataset, space: Space, values: Values, settings: PredictSettings) -> np.ndarray:
    """(W, M * C, k): how one inflated standard deviation of each start coordinate moves the prediction.

    What a low-pass of the readings holds moves apart from the state before it, which is known from its slope.
    """
    lags = _lags(data, space.settings([values]))
    sizes = start_sigma(data, lags, settings=settings)
    moves: list[dict[str, np.ndarray]] = []
    for channel, size in sizes.items():
        if size.any():
            moves.append({channel: size, **({memory_of(channel): np.zeros_like(size)} if channel in lags else {})})
    plain = start_sigma(data, settings=settings) if lags else {}
    moves += [{memory_of(channel): plain[channel]} for channel in lags if channel in plain]
    if not moves:
        return np.zeros((data.count, data.y.shape[1] * data.y.shape[2], 1))
    moved = predict_moved(data, space.settings([values]), [{}, *moves])
    moved[1:] -= moved[0].copy()
    moved[:, ~np.isfinite(data.y)] = 0.0
    change = np.moveaxis(np.nan_to_num(moved[1:], copy=False), 0, -1)
    return np.ascontiguousarray(change).reshape(data.count, -1, len(moves))


def _lags(data: Dataset, settings: Settings) -> dict[str, float]:
    """s: the low-pass of each channel that has one, under one hypothesis."""
    found = {}
    for block in data.blocks:
        here = settings.of_group(block.group)
        for channel in (c for s in block.robot.states for c in (s.position, s.velocity) if c in data.channels):
            lag = sensor_value(block.robot, here, "reading lag", channel)
            if lag is not None and lag[0] > 0.0:
                found[channel] = float(lag[0])
    return found


def start_sigma(
    data: Dataset, lags: Mapping[str, float] | None = None, *, settings: PredictSettings = PredictSettings()
) -> dict[str, np.ndarray]:
    """Inflated standard deviation (W,) of each start coordinate: the local fits' weights under white noise. lags: s,
    by channel, of a low-pass, whose input is y + lag dy/dt."""
    out: dict[str, np.ndarray] = {}
    for block in data.blocks:
        for state in block.robot.states:
            for channel, source, slope in state.sources:
                spread = out.setdefault(channel, np.zeros(data.count))
                for i in np.unique(data.run[block.where]):
                    signal = data.signals.get((int(i), source))
                    if signal is None:
                        continue
                    mine = np.flatnonzero(data.run == i)
                    fit = local_fit(signal.t, data.start[mine])
                    lag = 0.0 if lags is None else lags.get(source, 0.0)
                    weights = fit.slope_weights if slope else fit.value_weights
                    if lag:
                        weights = weights + lag * (fit.curvature_weights if slope else fit.slope_weights)
                    sigma = data.sigma[data.channels.index(source)]
                    spread[mine] = settings.start.inflation * sigma * np.sqrt((weights**2).sum(axis=1))
    return out
