"""How one signal follows another: correlation and slope over time shifts, gathered over runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.logs.run import FloatArray, Run, held
from residual_mpc.logs.signals import fresh_samples, unwrap_with_gaps


@dataclass(frozen=True)
class Follow:
    """How an answer follows its source.

    Attributes:
        lags: (k,) s, positive where the answer comes after the source.
        correlation: (k,) 1.
        slope: (k,) answer over source, by least squares.
    """

    lags: FloatArray
    correlation: FloatArray
    slope: FloatArray

    def best(self, sign: float = 1.0) -> int:
        """The index of the largest correlation times `sign`."""
        return int(np.argmax(sign * self.correlation))

    @property
    def lag(self) -> float:
        """The shift of the largest correlation, s, between the samples by a parabola."""
        k = self.best()
        if k in (0, len(self.lags) - 1):
            return float(self.lags[k])
        left, middle, right = self.correlation[k - 1 : k + 2]
        bend = left - 2.0 * middle + right
        shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
        return float(self.lags[k] + shift * (self.lags[1] - self.lags[0]))


@dataclass(frozen=True)
class Alignment:
    """How much of an answer its source leaves unexplained, by the shift between them.

    Attributes:
        lags: (k,) s, positive where the answer comes after the source; 0 in the middle.
        unexplained: (k,) share of the answer's power.
    """

    lags: FloatArray
    unexplained: FloatArray

    @property
    def lag(self) -> float | None:
        """The shift that explains the most, s, between the samples by a parabola; None where it may lie beyond."""
        k = int(np.argmin(self.unexplained))
        if k in (0, len(self.lags) - 1):
            return None
        left, middle, right = self.unexplained[k - 1 : k + 2]
        bend = left - 2.0 * middle + right
        shift = 0.5 * (left - right) / bend if bend > 0.0 else 0.0
        return float(self.lags[k] + shift * (self.lags[1] - self.lags[0]))

    @property
    def gain(self) -> float:
        """How many times more no shift leaves unexplained than the best shift."""
        return float(self.unexplained[len(self.lags) // 2] / max(1e-12, self.unexplained.min()))


def on_grid(run: Run, values: FloatArray, dt: float) -> FloatArray:
    """A measured column at even times, straight lines between its fresh samples; angles must be unwrapped."""
    fresh = fresh_samples(values)
    if np.count_nonzero(fresh) < 2:
        return np.full(_count(run, dt), np.nan)
    return np.interp(_grid(run, dt), run.t[fresh], values[fresh])


def position_on_grid(run: Run, name: str, dt: float) -> FloatArray:
    """`on_grid` of an angle, without its turns."""
    return on_grid(run, unwrap_with_gaps(run.columns[name]), dt)


def command_on_grid(run: Run, name: str, dt: float) -> FloatArray:
    """A command at even times: held, or joined by lines where a measured column serves as the command."""
    if run.served_as_command:
        return on_grid(run, run.columns[name], dt)
    at = np.searchsorted(run.t, _grid(run, dt) + 0.01 * dt, side="right") - 1
    return held(run, name)[np.maximum(at, 0)]


def enabled_on_grid(run: Run, actuator: str, dt: float) -> FloatArray:
    """1 where the actuator is on, 0 where it is off."""
    name = f"enabled.{actuator}"
    if name not in run.columns:
        return np.ones(_count(run, dt))
    at = np.searchsorted(run.t, _grid(run, dt) + 0.01 * dt, side="right") - 1
    return np.nan_to_num(held(run, name), nan=1.0)[np.maximum(at, 0)]


def clipped_deviations(
    signals: Sequence[FloatArray], weights: Sequence[FloatArray] | None = None, each: bool = True
) -> list[FloatArray]:
    """Signals about a mean, without their outermost hundredths, nought where the weight is.

    Args:
        signals: one (n_i,) signal each a run.
        weights: alike, 0 where a sample does not count.
        each: about each run's own mean (positions, whose zero may differ), else about the mean of all runs.
    """
    out, means, counts = [], [], []
    masks = [np.ones(len(x)) for x in signals] if weights is None else weights
    for x, weight in zip(signals, masks, strict=True):
        on = (weight > 0.0) & np.isfinite(x)
        kept = np.zeros(len(x))
        if on.any():
            kept[on] = np.clip(x[on], *np.quantile(x[on], [0.005, 0.995]))
        out.append((kept, on))
        means.append(float(kept[on].mean()) if on.any() else 0.0)
        counts.append(int(on.sum()))
    shared = float(np.dot(means, counts) / max(1, sum(counts)))
    about = means if each else [shared] * len(out)
    return [np.where(on, x - mean, 0.0) for (x, on), mean in zip(out, about, strict=True)]


def follow(sources: Sequence[FloatArray], answers: Sequence[FloatArray], dt: float, reach: float) -> Follow | None:
    """How answers follow sources, both about their means, over shifts of up to `reach` either way.

    Args:
        sources, answers: one (n_i,) signal each a run, sampled every dt s.
        reach: s; at most a third of the usual run is taken.

    Returns:
        None where either stands still.
    """
    most = int(min(round(reach / dt), np.median([len(u) for u in sources]) // 3))
    product = np.zeros(2 * most + 1)
    source_power = answer_power = 0.0
    for u, y in zip(sources, answers, strict=True):
        n = len(u)
        size = 1 << int(np.ceil(np.log2(n + most + 1)))
        spectrum = np.conj(np.fft.rfft(u, size)) * np.fft.rfft(y, size)
        shifted = np.fft.irfft(spectrum, size)  # shifted[k] = sum u[i] y[i + k]
        product += np.concatenate([shifted[size - most :], shifted[: most + 1]])
        source_power += float(u @ u)
        answer_power += float(y @ y)
    if source_power <= 1e-18 or answer_power <= 1e-18:
        return None
    shifts = np.abs(np.arange(-most, most + 1))
    count = np.array([len(u) for u in sources])[:, None]
    # a shifted signal overlaps less; unmended, this would pull the peak of slow signals towards no shift
    product *= count.sum() / np.maximum(1, np.maximum(0, count - shifts).sum(axis=0))
    lags = dt * np.arange(-most, most + 1, dtype=np.float64)
    return Follow(lags, product / np.sqrt(source_power * answer_power), product / source_power)


def align(sources: Sequence[FloatArray], answers: Sequence[FloatArray], dt: float, reach: float) -> Alignment | None:
    """How well sources explain answers over shifts of up to `reach` either way, by the same answers at every shift.

    Args:
        sources, answers: one (n_i,) signal each a run, sampled every dt s.
        reach: s; at most a third of the usual run is taken.

    Returns:
        None where either stands still.
    """
    most = int(min(round(reach / dt), np.median([len(u) for u in sources]) // 3))
    product, source_power, answer_power = np.zeros(2 * most + 1), np.zeros(2 * most + 1), 0.0
    shifts = np.arange(-most, most + 1)
    for u, y in zip(sources, answers, strict=True):
        n = len(u)
        if n <= 2 * most:
            continue
        inner = np.zeros(n)
        inner[most : n - most] = y[most : n - most]
        size = 1 << int(np.ceil(np.log2(n + most + 1)))
        shifted = np.fft.irfft(np.conj(np.fft.rfft(u, size)) * np.fft.rfft(inner, size), size)
        product += np.concatenate([shifted[size - most :], shifted[: most + 1]])
        power = np.concatenate([[0.0], np.cumsum(u * u)])
        source_power += power[n - most - shifts] - power[most - shifts]
        answer_power += float(inner @ inner)
    if source_power.min() <= 1e-18 or answer_power <= 1e-18:
        return None
    lags = dt * shifts.astype(np.float64)
    return Alignment(lags, 1.0 - product**2 / (source_power * answer_power))


def _grid(run: Run, dt: float) -> FloatArray:
    return run.t[0] + dt * np.arange(_count(run, dt))


def _count(run: Run, dt: float) -> int:
    # a run with a long gap is not worth more points than a few times its samples
    return max(2, min(int((run.t[-1] - run.t[0]) / dt) + 1, 4 * len(run.t)))
