"""The smallest learner: a ridge regression of what is left on integrated features of the motion.

A missing term delta(z) in the robot's rates shows in a window as its integral up to each sample, so the error is
regressed on integrals (and present values) of features of command and motion, each window from zero. It takes
hundredths of a second, knows of the joints' angle, and is tried beside the network.
"""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.settings import FitSettings


@dataclass(frozen=True)
class RidgeFit:
    """weights (F, C) on standardised features; `scale` (F,)."""

    weights: np.ndarray
    scale: np.ndarray


def fit_ridge(
    data: Dataset, scales: Scales, error: np.ndarray, predicted: np.ndarray, folds: np.ndarray, settings: FitSettings
) -> RidgeFit:
    """Fit error (W, M, C) on features of the prediction (W, M, C) and the commands; the ridge is chosen across
    folds (W,).
    """
    tuned = settings.ridge
    x = features(data, predicted, settings=settings)
    w, m, f = x.shape
    y = np.where(np.isfinite(error) & data.compared[:, None, :] & ~scales.still, error / scales.s, 0.0)
    seen = np.isfinite(error).any(axis=2)
    flat, target = x[seen], y[seen]
    scale = np.sqrt(np.mean(flat**2, axis=0)) + 1e-12
    flat = flat / scale
    fold = np.broadcast_to(folds[:, None], (w, m))[seen]
    part = [fold == k for k in np.unique(fold)]
    grams, crosses = [flat[p].T @ flat[p] for p in part], [flat[p].T @ target[p] for p in part]
    gram, cross = np.sum(grams, axis=0), np.sum(crosses, axis=0)
    scores = np.zeros(len(tuned.ridges))
    for g, c in zip(grams, crosses, strict=True):
        for i, ridge in enumerate(tuned.ridges):
            b = np.linalg.solve(gram - g + ridge * np.eye(f), cross - c)
            scores[i] += np.sum(b * (g @ b - 2.0 * c))
    scores += np.sum(target**2)  # the squared errors on windows that were left out of each fit
    ridge = tuned.ridges[int(np.argmin(scores))]
    weights = np.linalg.solve(gram + ridge * np.eye(f), cross)
    if scores.min() >= np.sum(target**2):  # it does not help on windows that it has not seen
        weights = np.zeros_like(weights)
    return RidgeFit(weights, scale)


def subtract_ridge(
    fitted: RidgeFit, data: Dataset, scales: Scales, error: np.ndarray, predicted: np.ndarray, settings: FitSettings
) -> np.ndarray:
    """The error less what the learner predicts of it, (W, M, C)."""
    return np.asarray(error - (features(data, predicted, settings=settings) / fitted.scale) @ fitted.weights * scales.s)


def features(data: Dataset, predicted: np.ndarray, settings: FitSettings) -> np.ndarray:
    """(W, M, F): integrals from the window's start, and changes since it, of basis functions of the motion."""
    w, m, _ = data.y.shape
    t = np.nan_to_num(data.t)
    dt = np.diff(t, axis=1, prepend=0.0)
    dt = np.where(np.isfinite(data.t), np.maximum(dt, 0.0), 0.0)
    signals: list[np.ndarray] = []
    heading = None
    for block in data.blocks:
        rows, drive = block.where, block.drive
        at = np.clip((t[rows] / drive.dt).astype(int), 0, drive.steps - 1)
        for k in range(drive.command.shape[2]):
            while len(signals) <= k:
                signals.append(np.zeros((w, m)))
            signals[k][rows] = np.take_along_axis(drive.command[:, drive.lead :, k], at, axis=1)
    positions = []
    for k, c in enumerate(data.channels):
        p = np.nan_to_num(predicted[..., k])
        if c == "pose.theta":
            heading = p
        elif c.startswith("position."):
            positions.append(p)
            signals.append(np.gradient(p, axis=1) / np.maximum(np.median(dt[dt > 0]), 1e-6))
    size = [np.sqrt(np.mean(s**2)) + 1e-9 for s in signals]
    z = [s / q for s, q in zip(signals, size, strict=True)]
    basis = [np.ones((w, m)), *z, *(np.tanh(5.0 * a) for a in z), *(a * np.abs(a) for a in z)]
    basis += [a * b for i, a in enumerate(z[:4]) for b in z[i + 1 : 4]]
    basis += [np.abs(a) for a in z]
    for p in positions:
        basis += [fn(h * p) for h in range(1, settings.ridge.harmonics + 1) for fn in (np.sin, np.cos)]
    if heading is not None:  # a rate in the body's frame drives x and y through the heading
        c, s = np.cos(heading), np.sin(heading)
        basis = basis + [b * c for b in basis] + [b * s for b in basis]
    stack = np.stack(basis, axis=-1)
    integral = np.cumsum(stack * dt[..., None], axis=1)
    change = stack - stack[:, :1]
    return np.concatenate([integral, change], axis=-1)
