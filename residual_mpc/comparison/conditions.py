"""How each window was driven: the model's own errors depend on it, and are no change where the sets were driven
differently."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.models.protocol import Robot

LEAST = 1e-6


def conditions_of(data: Dataset, scales: Scales, robots: Sequence[Robot], later: np.ndarray) -> np.ndarray:
    """(W, 1 or 2): how far the robot moves within a window, and the setting of its run, as the main component of the
    nominal parameters that differ within both sets (what differs between them alone may be a change). robots: of each
    run; later (R,) bool. Each has mean 0 and variance 1."""
    setting = _settings(robots, later)
    columns = [_moved(data, scales)]
    if setting is not None:
        columns.append(setting[data.run])
    return np.column_stack([_standard(c) for c in columns])


def driving_of(data: Dataset) -> np.ndarray:
    """(W, k) principal components of the commands of the windows (mean, mean magnitude and standard deviation of each
    command), largest first, each with mean 0 and variance 1."""
    rows = np.zeros((data.count, 3 * max(b.drive.command.shape[2] for b in data.blocks)))
    for b in data.blocks:
        u = b.drive.command[:, b.drive.lead :]
        of = np.concatenate([u.mean(axis=1), np.abs(u).mean(axis=1), u.std(axis=1)], axis=1)
        rows[b.where, : of.shape[1]] = of
    scaled = np.apply_along_axis(_standard, 0, rows)
    left, size, _ = np.linalg.svd(scaled, full_matrices=False)
    there = size > LEAST * size.max(initial=0.0)
    return np.asarray(left[:, there] * np.sqrt(len(rows)))


def balanced(columns: np.ndarray, later: np.ndarray, most: int, apart: float) -> np.ndarray:
    """(U, at most `most`) the first columns of (U, k) whose means before and after differ by less than `apart`
    standard deviations. A component that differs could hide the change, since a controller reacts to a change with
    different commands."""
    spread = np.sqrt(0.5 * (columns[later].var(axis=0) + columns[~later].var(axis=0)))
    difference = np.abs(columns[later].mean(axis=0) - columns[~later].mean(axis=0))
    return columns[:, (difference < apart * spread) & (spread > 0.0)][:, :most]


def driven_differently(data: Dataset, later: np.ndarray, unlike: float) -> str:
    """How the commands of the later windows (W,) bool differ in size and speed, in words; empty where both ratios are
    below `unlike`."""
    words = ("vary {} times as much", "change {} times as fast")
    ratios = (_ratio(squares, later) for squares in _command_squares(data))
    return " and ".join(w.format(f"{r:.2g}") for w, r in zip(words, ratios, strict=True) if _apart(r, unlike))


def unlike_of(data: Dataset, later: np.ndarray, unlike: float) -> np.ndarray:
    """(W, 0 to 2) logarithms of the size and the speed of the commands, of those in which the later windows (W,) bool
    differ by at least the ratio `unlike`, each with mean 0 and variance 1. What the model gets wrong may depend on
    them: it then looks like a change."""
    columns = [
        _standard(np.log(np.sqrt(squares.mean(axis=1)) + LEAST))
        for squares in _command_squares(data)
        if _apart(_ratio(squares, later), unlike)
    ]
    return np.column_stack(columns) if columns else np.zeros((data.count, 0))


def _command_squares(data: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """(W, nu) each: the variance of each command within a window, and the mean square of its rate."""
    size, rate = np.zeros((2, data.count, max(b.drive.command.shape[2] for b in data.blocks)))
    for b in data.blocks:
        u = b.drive.command[:, b.drive.lead :]
        size[b.where, : u.shape[2]] = u.var(axis=1)
        rate[b.where, : u.shape[2]] = (np.diff(u, axis=1) ** 2).mean(axis=1) / b.drive.dt**2
    return size, rate


def _ratio(squares: np.ndarray, later: np.ndarray) -> float:
    """Of the later windows to the others: the geometric mean over the commands of the ratios of their root mean
    squares."""
    before, after = squares[~later].mean(axis=0), squares[later].mean(axis=0)
    there = (before > 0.0) & (after > 0.0)
    return float(np.exp(0.5 * np.mean(np.log(after[there] / before[there])))) if there.any() else 1.0


def _apart(ratio: float, unlike: float) -> bool:
    return not 1.0 / unlike <= ratio <= unlike


def _moved(data: Dataset, scales: Scales) -> np.ndarray:
    """(W,) logarithm of the root mean square of the motion, relative to that of all windows."""
    y = np.where(data.compared[:, None, :] & ~scales.still, data.y, np.nan)
    there = np.isfinite(y)
    first = np.take_along_axis(y, np.argmax(there, axis=1)[:, None, :], axis=1)
    square = np.where(there, ((y - first) / scales.s) ** 2, 0.0).sum(axis=(1, 2))
    return np.asarray(np.log(np.sqrt(square / np.maximum(there.sum(axis=(1, 2)), 1)) + LEAST))


def _settings(robots: Sequence[Robot], later: np.ndarray) -> np.ndarray | None:
    """(R,) the setting of each run; None where all are alike."""
    nominal = [robot.nominal() for robot in robots]
    names = sorted(set.intersection(*(set(n) for n in nominal)))
    table = np.array([[n[name] for name in names] for n in nominal]).reshape(len(robots), len(names))
    varies = [np.ptp(table[later], axis=0) > 0.0, np.ptp(table[~later], axis=0) > 0.0]
    table = table[:, varies[0] & varies[1]]
    if not table.size:
        return None
    scaled = np.apply_along_axis(_standard, 0, np.sign(table) * np.log(np.abs(table) + LEAST))
    return np.asarray(scaled @ np.linalg.svd(scaled, full_matrices=False)[2][0])


def _standard(x: np.ndarray) -> np.ndarray:
    spread = float(np.std(x))
    return np.asarray((x - x.mean()) / spread if spread > 0.0 else np.zeros(len(x)))
