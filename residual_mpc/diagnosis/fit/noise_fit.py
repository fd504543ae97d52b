"""The sensor noise that what a model leaves can hold: the largest stationary noise consistent with its increments.

What a model misses is the sensors' noise plus what the model does wrong. Noise is stationary and rough: the mean square
of its increments, D(lag) = E[(n(t + lag) - n(t))^2], is a sum of a constant (white) and of saturating exponentials
(coloured), and thus concave in the lag. A rate that a model lacks adds up instead, D(lag) ~ lag^2. The noise is fitted
under the measured D by non-negative least squares that weigh an excess more than a shortfall, so that a missing effect
is left over. What a learner predicts of the remainder on windows that it has not seen is no noise either, and is taken
out first.

High-order differences of the measurements themselves, of every n-th sample, bound the noise from above as well,
whatever the model: they are those of the noise, and of what they leave of the motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, window_trust
from residual_mpc.diagnosis.data.noise_model import ChannelNoise, ornstein_uhlenbeck
from residual_mpc.diagnosis.data.window_samples import fresh_in_windows
from residual_mpc.diagnosis.fit.cross_validation import folds_of
from residual_mpc.diagnosis.fit.noise_envelope import difference_bounds, fit_envelope
from residual_mpc.diagnosis.fit.noise_evenness import as_even_as_noise
from residual_mpc.diagnosis.fit.ridge import fit_ridge, subtract_ridge
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.models.settings import Settings

# reported by a filter or a scan matching; an encoder wanders by no more than it jitters, unless its residual is as
# large in slow motion as in fast
LOCALISED = ("pose.", "twist.")


def with_noise(
    data: Dataset, problem: Problem, scales: Scales, predicted: np.ndarray, settings: FitSettings
) -> Dataset:
    """The data with the noise that the prediction (W, M, C) leaves on the problem's windows, whose channels are the
    same. What the user states of a channel stands; the colour is the data's."""
    return replace(data, noise=stated_sizes(data, fit_noise(problem, scales, predicted, settings=settings)))


def no_more_than_left(
    noise: tuple[ChannelNoise, ...],
    data: Dataset,
    scales: Scales,
    row: Settings,
    settings: FitSettings,
) -> tuple[ChannelNoise, ...]:
    """The noise with each channel's size such that it makes no more of a gap than the model `row` leaves there."""
    tuned = settings.noise
    error = data.y - predict(data, row)[0]
    trust = window_trust(data, scales, error, settings=settings.data)
    left = gap_of(data, scales, error, trust).channels
    for _ in range(tuned.size_rounds):  # the channels' noises act on each other through the start states
        drawn = noise_errors(replace(data, noise=noise), row, np.random.default_rng(0), tuned.draws)
        makes = np.sqrt(np.mean([gap_of(data, scales, e, trust).channels ** 2 for e in drawn], axis=0))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.nan_to_num(np.where(makes > left, left / makes, 1.0), nan=1.0)
        noise = tuple(n.scaled_to(n.sigma * float(r)) for n, r in zip(noise, ratio, strict=True))
        if (ratio > tuned.enough).all():
            break
    return noise


def stated_sizes(data: Dataset, noise: tuple[ChannelNoise, ...]) -> tuple[ChannelNoise, ...]:
    """The noise with the sizes that the user states."""
    return tuple(
        (n.scaled_to(data.stated[c]) if n.sigma > 0.0 else ChannelNoise(data.stated[c])) if c in data.stated else n
        for c, n in zip(data.channels, noise, strict=True)
    )


def fit_noise(
    problem: Problem, scales: Scales, predicted: np.ndarray, settings: FitSettings
) -> tuple[ChannelNoise, ...]:
    """The noise of each channel, from what a model's prediction (W, M, C) leaves on the problem's windows.

    The problem's weights are those of the white noise. Deterministic: the draws have a seed of their own.
    """
    tuned = settings.noise
    problem, predicted = _steady(problem, scales, predicted, settings=settings)
    data = problem.data
    # errors of the start states go first: they are not noise, and the regression would learn them from a few windows.
    # Repeats are errors of the speed, which would make the noise of an encoder look uneven
    seen = fresh_in_windows(data)
    weight = np.maximum(problem.weight, 1e-12)
    error = np.where(seen, _projected(np.where(seen, data.y - predicted, 0.0) * weight, problem.basis) / weight, np.nan)
    left = unlearnable(data, scales, error, predicted, settings=settings)
    # evenly spread windows say as much as all of them
    keep = np.unique(np.linspace(0, data.count - 1, min(data.count, tuned.windows)).round().astype(int))
    left, y, t, basis, predicted = left[keep], data.y[keep], data.t[keep], problem.basis[keep], predicted[keep]
    seen = np.isfinite(y) & np.isfinite(left)
    lags = _lags(t.shape[1], seen)
    scaled = np.where(seen, left * problem.weight, 0.0)
    projected = _projected(scaled, basis)
    measured, sure = _increments(projected, seen, lags, settings=settings)  # (C, L)
    period = float(np.nanmedian(np.diff(t, axis=1)))
    times = [time for time in tuned.times if time > 0.7 * period]
    rng = np.random.default_rng(0)
    c = len(data.channels)
    parts = np.zeros((c, len(lags), c, 1 + len(times)))
    for p, time in enumerate([0.0, *times]):
        for _ in range(tuned.draws):
            drawn = _unit(t, period, time, rng)  # each channel in turn is replaced by it
            for k in range(c):
                if seen[..., k].any():
                    unit = np.zeros_like(scaled)
                    unit[..., k] = np.where(seen[..., k], drawn, 0.0)
                    parts[:, :, k, p] += (
                        _increments(_projected(unit, basis), seen, lags, settings=settings)[0] / tuned.draws
                    )
    bounds = difference_bounds(data, problem.weight, [0.0, *times], period, settings=settings)
    encoders = np.array([not channel.startswith(LOCALISED) for channel in data.channels])
    if data.count * data.horizon < tuned.least_seconds:
        parts[..., 1:] = 0.0
    size = fit_envelope(measured, parts, sure, *bounds, settings=settings)  # (C, 1 + times) squared, of the white noise
    wander = np.sqrt(size[:, 1:].sum(axis=1)) / problem.weight  # (C,) channel unit
    steps = encoders & (wander <= tuned.rounded * data.steps / np.sqrt(12.0))
    if size[steps, 1:].any():
        parts[:, :, steps, 1:] = 0.0  # steps of an encoder that last several samples look coloured
        size = fit_envelope(measured, parts, sure, *bounds, settings=settings)
    beyond = encoders & (size[:, 1:].sum(axis=1) > (data.sigma * problem.weight) ** 2)

    def draw() -> np.ndarray:
        return _projected(np.where(seen, _drawn(t, period, np.sqrt(size), times, rng), 0.0), basis)

    few = lags[lags * period <= tuned.compared]
    free = ~encoders | as_even_as_noise(beyond, projected, seen, predicted, few, draw, tuned)
    out = []
    known = (sure > 0.0).sum(axis=1) >= tuned.fewest_lags
    for k in range(len(data.channels)):
        if not known[k] or not size[k, 1:].any():  # white, or too few samples in a window to tell
            out.append(ChannelNoise(float(data.sigma[k])))
            continue
        most = np.inf if free[k] else float(data.sigma[k])
        rounding = float(data.steps[k]) / np.sqrt(12.0)
        out.append(_channel_noise(np.sqrt(size[k]) / problem.weight[k], times, rounding, most))
    return tuple(out)


def _channel_noise(sigma: np.ndarray, times: Sequence[float], rounding: float, most: float) -> ChannelNoise:
    """Noise of these sizes (1 + times,), white first, channel unit; what rounding makes of it is white; most: that the
    coloured parts may have together."""
    white = max(float(sigma[0]), rounding)
    coloured = float(np.sum(sigma[1:] ** 2))
    room = min(max(float(np.sum(sigma**2)) - white**2, 0.0), most**2)
    factor = np.sqrt(min(room / coloured, 1.0)) if coloured > 0.0 else 0.0
    parts = ((float(s * factor), time) for s, time in zip(sigma[1:], times, strict=True))
    return ChannelNoise(white, tuple(p for p in parts if p[0] > 0.0))


def unlearnable(
    data: Dataset, scales: Scales, error: np.ndarray, predicted: np.ndarray, settings: FitSettings
) -> np.ndarray:
    """The error (W, M, C) less what a ridge regression on the motion predicts of it on windows it was not fitted to."""
    out = error.copy()
    if data.y.shape[1] < settings.noise.fewest_lags:
        return out
    folds = folds_of(data, settings=settings)
    for k in np.unique(folds):
        test, train = folds == k, folds != k
        if not train.any() or len(np.unique(folds[train])) < 2:
            continue
        some = data.take(train)
        fitted = fit_ridge(some, scales, error[train], predicted[train], folds[train], settings=settings)
        if fitted.weights.any():
            out[test] = subtract_ridge(fitted, data.take(test), scales, error[test], predicted[test], settings=settings)
    return out


def _steady(
    problem: Problem, scales: Scales, predicted: np.ndarray, settings: FitSettings
) -> tuple[Problem, np.ndarray]:
    """The problem and its prediction on the windows that do not diverge, evenly fewer where there are very many."""
    data = problem.data
    finite = np.isfinite(np.where(np.isfinite(data.y), predicted, 0.0)).all(axis=(1, 2))
    good = np.flatnonzero(finite & (window_trust(data, scales, data.y - predicted, settings=settings.data) == 1.0))
    if len(good) < 2:
        return problem, predicted
    some = np.zeros(data.count, dtype=bool)
    some[good[np.unique(np.linspace(0, len(good) - 1, min(len(good), settings.noise.learned)).round().astype(int))]] = (
        True
    )
    return (problem, predicted) if some.all() else (part_of(problem, some), predicted[some])


def _lags(samples: int, seen: np.ndarray) -> np.ndarray:
    """(L,) samples: about three an octave, to four fifths of a window, of the log's rate and of the slower channels' in
    seen (W, M, C)."""
    out: set[int] = set()
    for k in range(seen.shape[2]):
        gaps = [np.diff(np.flatnonzero(row)) for row in seen[:8, :, k]]
        spacing = int(np.median(np.concatenate(gaps))) if any(len(g) for g in gaps) else 1
        most = max(int(0.8 * samples) // spacing, 1)
        count = max(3, int(3 * np.log2(most + 1)))
        out |= {spacing * int(round(x)) for x in np.geomspace(1, most, count)}
    return np.array(sorted(lag for lag in out if lag < samples), dtype=int)


def _projected(scaled: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """(W, M, C) without what an error of the window's start can make of it."""
    flat = scaled.reshape(len(scaled), -1)
    along = np.einsum("wnk,wn->wk", basis, flat)
    return np.asarray(flat - np.einsum("wnk,wk->wn", basis, along)).reshape(scaled.shape)


def _unit(t: np.ndarray, period: float, time: float, rng: np.random.Generator) -> np.ndarray:
    """(W, M) noise of unit variance: white (time 0) or with a correlation time in s."""
    if time == 0.0:
        return rng.standard_normal(t.shape)
    return ornstein_uhlenbeck(np.arange(t.shape[1]) * period, time, len(t), rng)


def _drawn(
    t: np.ndarray, period: float, sigma: np.ndarray, times: Sequence[float], rng: np.random.Generator
) -> np.ndarray:
    """(W, M, C) noise whose parts have the sizes (C, 1 + times), white first."""
    parts = [0.0, *times]
    out = np.zeros((*t.shape, len(sigma)))
    for k, sizes in enumerate(sigma):
        for s, time in zip(sizes, parts, strict=True):
            if s > 0.0:
                out[..., k] += s * _unit(t, period, time, rng)
    return out


def _increments(
    r: np.ndarray, seen: np.ndarray, lags: Sequence[int] | np.ndarray, settings: FitSettings
) -> tuple[np.ndarray, np.ndarray]:
    """(C, L) mean squares of r (W, M, C) at t + lag less r at t, and on how many stretches of a lag's length each
    rests."""
    out = np.zeros((r.shape[2], len(lags)))
    sure = np.zeros(out.shape)
    for i, lag in enumerate(lags):
        both = seen[:, lag:] & seen[:, :-lag]
        count = both.sum(axis=(0, 1))
        square = np.where(both, (r[:, lag:] - r[:, :-lag]) ** 2, 0.0).sum(axis=(0, 1))
        out[:, i] = square / np.maximum(count, 1)
        sure[:, i] = np.where(count >= settings.noise.fewest_pairs, count / lag, 0.0)
    return out, sure
