"""Whether what a model leaves is as large in slow motion as in fast, and everywhere: noise of a sensor is, errors of a
model are not.

A coloured noise and an error of the model may leave the same increments. Noise does not depend on the motion. What a
model gets wrong of a force, a speed or a time grows with speed or acceleration; a spring, a cable or a load that it
lacks acts in some places more than in others. The increments are sorted into thirds by how much the prediction moves
meanwhile, by how much its speed changes, and by where it is, and their mean squares are compared. Stamps that are off
by chance leave errors that grow with speed as well, but are independent from one sample to the next: the shortest
increments tell their size, which is taken out of all others.
"""

from collections.abc import Callable, Sequence

import numpy as np

from residual_mpc.diagnosis.fit.settings import NoiseFitSettings


def as_even_as_noise(
    which: np.ndarray,
    left: np.ndarray,
    seen: np.ndarray,
    predicted: np.ndarray,
    lags: Sequence[int] | np.ndarray,
    draw: Callable[[], np.ndarray],
    tuned: NoiseFitSettings,
) -> np.ndarray:
    """(C,) bool: of the channels `which` (C,), those that leave increments hardly more uneven than noise does in the
    most uneven of several draws, and never more uneven than `tuned.uneven`. draw: noise (W, M, C) of the size in
    question; for the others see `unevenness`."""
    if not which.any():
        return which
    found = unevenness(left, seen, predicted, lags, tuned)
    even = which & (found <= tuned.uneven)
    most = np.zeros(len(which))
    for _ in range(tuned.even_draws if even.any() else 0):
        most = np.maximum(most, unevenness(draw(), seen, predicted, lags, tuned))
    return np.asarray(even & (found <= tuned.luck * most))


def unevenness(
    left: np.ndarray, seen: np.ndarray, predicted: np.ndarray, lags: Sequence[int] | np.ndarray, tuned: NoiseFitSettings
) -> np.ndarray:
    """(C,) the largest mean square of the increments in a third over the smallest, of thirds by speed, by acceleration
    and by place of the prediction (W, M, C); infinity where there are too few to compare.

    left, seen (W, M, C): what the model leaves, and where that is known. lags: samples; long ones say little, since the
    motion changes meanwhile.
    """
    rate = np.abs(np.gradient(predicted, axis=1))
    change = np.abs(np.gradient(np.gradient(predicted, axis=1), axis=1))
    place = predicted - np.nanmin(predicted, axis=(0, 1))
    out = []
    for k in range(left.shape[2]):
        off = _stamp_errors(left[..., k], seen[..., k], rate[..., k], tuned)
        sizes = (rate[..., k], change[..., k], place[..., k])
        out.append(max(_ratio(left[..., k], seen[..., k], off, size, lags, tuned) for size in sizes))
    return np.array(out)


def _stamp_errors(left: np.ndarray, seen: np.ndarray, rate: np.ndarray, tuned: NoiseFitSettings) -> np.ndarray:
    """(W, M) variance of what errors of the stamps, independent of one another, leave of a channel that moves by `rate`
    (W, M) a sample: proportional to its square, from thirds by it of the increments from each sample to the next."""
    square = np.nan_to_num(rate) ** 2
    both = seen[:, 1:] & seen[:, :-1]
    increments = ((left[:, 1:] - left[:, :-1])[both]) ** 2
    moved = (square[:, 1:] + square[:, :-1])[both]
    if len(increments) < 3 * tuned.fewest_pairs or not moved.any():
        return np.zeros_like(square)
    slow, _, fast = np.array_split(np.argsort(moved, kind="stable"), 3)
    apart = float(moved[fast].mean() - moved[slow].mean())
    more = float(increments[fast].mean() - increments[slow].mean())
    return square * max(more / apart, 0.0) if apart > 0.0 else np.zeros_like(square)


def _ratio(
    left: np.ndarray,
    seen: np.ndarray,
    off: np.ndarray,
    size: np.ndarray,
    lags: Sequence[int] | np.ndarray,
    tuned: NoiseFitSettings,
) -> float:
    """The ratio for one channel (W, M), less the variance `off` (W, M) of single samples, with thirds by the mean of
    `size` (W, M) over each increment."""
    passed = np.cumsum(np.nan_to_num(size), axis=1)
    shares = np.zeros(3)
    used = 0
    for lag in lags:
        both = seen[:, lag:] & seen[:, :-lag]
        square = ((left[:, lag:] - left[:, :-lag])[both]) ** 2
        if len(square) < 3 * tuned.fewest_pairs or not square.any():
            continue
        moved = (passed[:, lag:] - passed[:, :-lag])[both]
        third = np.searchsorted(np.quantile(moved, [1 / 3, 2 / 3]), moved)
        if len(np.unique(third)) < 3:  # it stands still most of the time: nothing to compare
            continue
        noise = square - (off[:, lag:] + off[:, :-lag])[both]
        thirds = np.array([noise[third == i].mean() for i in range(3)])
        if (mean := float(noise.mean())) <= 0.0:
            continue
        shares += thirds / mean
        used += 1
    return float(shares.max() / shares.min()) if used and shares.min() > 0.0 else np.inf
