"""All columns of all recordings on one even grid, and how one follows another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.recording import Recording
from residual_mpc.init.columns.time_column import Clock, seconds
from residual_mpc.logs.run import FloatArray

REACH = 0.5  # s: the latest answer that is looked for
MOST = 150_000  # samples on the grid
COARSEST = 0.02  # s between them, unless the log is coarser
SMOOTH = 0.04  # s: the mean that is taken before a derivative
STILL = 1e-9  # of a column's size: what moves less does not move


@dataclass(frozen=True)
class SignalMatch:
    """How an answer follows a source.

    Attributes:
        lag: s, positive where the answer comes later.
        correlation: there; negative only where the answer goes against the source clearly more than with it, since a
            swing goes against itself half a period later.
        slope: answer over source, there.
        against: the largest correlation of the other sign, by size.
    """

    lag: float
    correlation: float
    slope: float
    against: float = 0.0

    @property
    def opposite(self) -> bool:
        """Whether the answer goes against the source, and explains it far better so than any later answer with it."""
        return self.correlation < 0.0 and _far_better(-self.correlation, self.against)

    def per(self, gear: float) -> SignalMatch:
        """How the answer follows the source divided by a gear."""
        return replace(self, correlation=self.correlation if gear > 0.0 else -self.correlation, slope=self.slope * gear)

    def words(self, source: str) -> str:
        """What it says of an answer, such as `follows it by 85 ms (correlation 0.83)`."""
        how = f"follows {source} by {self.lag * 1e3:.0f} ms" if abs(self.lag) < REACH else f"correlates with {source}"
        return f"{how} (correlation {self.correlation:.2f})"


CLEAR = 0.85  # correlation
NOTHING = SignalMatch(0.0, 0.0, 0.0)
MARGIN = 0.15  # correlation by which the other sign has to be ahead
NEARLY, SHARE = 0.95, 0.2  # or its correlation, and the share of what one sign leaves unexplained that the other leaves


def _far_better(one: float, other: float) -> bool:
    """Whether a correlation explains nearly all, and leaves far less unexplained than another one."""
    return one > NEARLY and 1.0 - one**2 < SHARE * (1.0 - other**2)


@dataclass(frozen=True, eq=False)
class Signals:
    """Attributes:
    dt: s between samples of the grid.
    raw: by column, (n,) over all runs one after the other with a pause of REACH between them, NaN in the pauses.
    run: (n,) number of the run, -1 in the pauses.
    whole: columns that hold whole numbers alone, as encoders count.
    """

    dt: float
    raw: Mapping[str, FloatArray]
    run: np.ndarray
    whole: frozenset[str] = frozenset()
    _spectra: dict[tuple[str, bool, bool], tuple[np.ndarray, float]] = field(default_factory=dict, repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.raw)

    @cached_property
    def size(self) -> int:
        return 1 << int(np.ceil(np.log2(len(self.run) + 1)))

    def rate(self, name: str) -> FloatArray:
        """(n,) the derivative by the time, 1/s, NaN in the pauses and at the runs' ends."""
        width = max(1, round(SMOOTH / self.dt) | 1)
        smooth = np.convolve(self.raw[name], np.ones(width) / width, mode="same")
        return np.gradient(smooth, self.dt)

    def moves(self, name: str) -> bool:
        """Whether the column ever changes."""
        x = self.raw[name]
        return bool(np.isfinite(x).any() and np.nanmax(x) - np.nanmin(x) > STILL * max(1e-12, np.nanmax(np.abs(x))))

    def follows(
        self, source: str, answer: str, source_rate: bool = False, answer_rate: bool = False, levels: bool = False
    ) -> SignalMatch:
        """How one column (or its rate) follows another (or its rate), over lags of up to REACH either way; about each
        run's mean (positions, whose zero may differ), or with `levels` about the mean of all runs (speeds)."""
        u, power_u = self._spectrum(source, source_rate, levels)
        y, power_y = self._spectrum(answer, answer_rate, levels)
        return self._seen(u, power_u, y, power_y)

    def _seen(self, u: np.ndarray, power_u: float, y: np.ndarray, power_y: float) -> SignalMatch:
        if power_u <= 0.0 or power_y <= 0.0:
            return NOTHING
        most = max(1, round(REACH / self.dt))
        shifted = np.fft.irfft(np.conj(u) * y, self.size)
        product = np.concatenate([shifted[-most:], shifted[: most + 1]])
        lags = np.arange(-most, most + 1)
        inside = int((self.run >= 0).sum())
        runs = int(self.run.max()) + 1
        product = product * inside / np.maximum(0.5 * inside, inside - runs * np.abs(lags))  # less overlaps there
        ways = {sign: int(np.argmax(sign * product)) for sign in (1, -1)}
        scale = float(np.sqrt(power_u * power_y))
        sizes = {sign: max(0.0, float(sign * product[k]) / scale) for sign, k in ways.items()}
        sooner = abs(lags[ways[-1]]) < abs(lags[ways[1]])
        ahead = sizes[-1] > sizes[1] + MARGIN or (sooner and _far_better(sizes[-1], sizes[1]))
        sign = -1 if ahead else 1
        k = ways[sign]
        lag = float(lags[k])
        if 0 < k < len(lags) - 1:
            left, middle, right = sign * product[k - 1 : k + 2]
            bend = left - 2.0 * middle + right
            lag += 0.5 * (left - right) / bend if bend < 0.0 else 0.0
        return SignalMatch(
            lag * self.dt, sign * min(1.0, sizes[sign]), float(product[k] / power_u), min(1.0, sizes[-sign])
        )

    def _spectrum(self, name: str, rate: bool, levels: bool) -> tuple[np.ndarray, float]:
        key = (name, rate, levels)
        if key not in self._spectra:
            x = self._tamed(self.rate(name) if rate else self.raw[name], levels)
            self._spectra[key] = self._transformed(x if self.moves(name) else np.zeros(len(x)))
        return self._spectra[key]

    def _transformed(self, x: FloatArray) -> tuple[np.ndarray, float]:
        return np.fft.rfft(x, self.size), float(x @ x)

    def _tamed(self, x: FloatArray, levels: bool) -> FloatArray:
        """(n,) about the mean, its outermost hundredths cut, 0 where missing."""
        there = np.isfinite(x)
        out = np.zeros(len(x))
        if not there.any():
            return out
        out[there] = np.clip(x[there], *np.quantile(x[there], [0.002, 0.998]))
        if levels:
            out[there] -= out[there].mean()
            return out
        count = np.bincount(self.run[there], minlength=int(self.run.max()) + 1)
        mean = np.bincount(self.run[there], out[there], minlength=len(count)) / np.maximum(count, 1)
        out[there] -= mean[self.run[there]]
        return out


def gather(recordings: Sequence[Recording], clock: Clock) -> Signals:
    """The columns of numbers of all recordings, without the time.

    Raises BadInput where no recording has two stamps.
    """
    stamped = [s for s in (_stamped(r, clock) for r in recordings) if s is not None]
    if not stamped:
        raise BadInput(
            f"no run has two increasing time stamps in {clock.column!r}", str(recordings[0].source), "record again"
        )
    period = float(np.median(np.concatenate([np.diff(t) for t, _, _ in stamped])))
    total = float(sum(t[-1] for t, _, _ in stamped))
    dt = float(np.clip(total / MOST, period, max(period, COARSEST)))
    share = min(1.0, MOST * dt / total)  # of each run, from its beginning
    pause = np.full(max(1, round(REACH / dt)) + 1, np.nan)
    names = list(dict.fromkeys(n for r in recordings for n in r.columns if n != clock.column))
    pieces: dict[str, list[FloatArray]] = {name: [] for name in names}
    runs = []
    for number, (t, rows, recording) in enumerate(stamped):
        grid = np.arange(0.0, max(share * t[-1], 4 * dt), dt)
        grid = grid[: max(2, np.searchsorted(grid, t[-1], side="right"))]
        for name in names:
            pieces[name] += [_on(grid, t, recording.columns[name][rows] if name in recording.columns else None), pause]
        runs += [np.full(len(grid), number), np.full(len(pause), -1)]
    whole = frozenset(name for name in names if all(_whole(r.columns.get(name)) for r in recordings))
    return Signals(dt, {name: np.concatenate(p) for name, p in pieces.items()}, np.concatenate(runs), whole)


def _whole(values: FloatArray | None) -> bool:
    return values is None or bool(np.all(np.rint(values[np.isfinite(values)]) == values[np.isfinite(values)]))


def _stamped(recording: Recording, clock: Clock) -> tuple[FloatArray, np.ndarray, Recording] | None:
    """(stamps (m,) s from 0, their rows (m,), recording), increasing; None with fewer than two."""
    t = seconds(clock, recording)
    rows = np.flatnonzero(np.isfinite(t))
    if len(rows) < 2:
        return None
    top = np.maximum.accumulate(t[rows])
    rows = rows[np.append(True, t[rows][1:] > top[:-1])]
    return (t[rows] - t[rows][0], rows, recording) if len(rows) > 1 else None


def _on(grid: FloatArray, t: FloatArray, values: FloatArray | None) -> FloatArray:
    if values is None:
        return np.full(len(grid), np.nan)
    there = np.isfinite(values)
    if there.sum() < 2:
        return np.full(len(grid), values[there][0] if there.any() else np.nan)
    return np.interp(grid, t[there], values[there])
