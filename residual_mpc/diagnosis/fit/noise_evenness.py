"""Whether what a model leaves is as large in slow motion as in fast, and everywhere: noise of a sensor is, errors of a
model are not.

A coloured noise and an error of the model may leave the same increments. Noise does not depend on the motion. What a
model gets wrong of a force, a speed or a time grows with speed or acceleration; a spring, a cable or a load that it
lacks acts in some places more than in others. The increments are sorted into thirds by how much the prediction moves
meanwhile, by how much its speed changes, and by where it is, and their mean squares are compared.
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
    return np.array(
        [
            max(_ratio(left[..., k], seen[..., k], size[..., k], lags, tuned) for size in (rate, change, place))
            for k in range(left.shape[2])
        ]
    )


def _ratio(
    left: np.ndarray, seen: np.ndarray, size: np.ndarray, lags: Sequence[int] | np.ndarray, tuned: NoiseFitSettings
) -> float:
    """The ratio for one channel (W, M), with thirds by the mean of `size` (W, M) over each increment."""
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
        shares += np.array([square[third == i].mean() for i in range(3)]) / square.mean()
        used += 1
    return float(shares.max() / shares.min()) if used and shares.min() > 0.0 else np.inf
