"""Measured signals by run and channel, and each channel concatenated over all runs."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

APART = 10.0  # s between concatenated runs: beyond the reach of any fit


@dataclass(frozen=True)
class Signal:
    """The samples of one channel of one run that are not missing: t (n,) s, y (n,) channel unit."""

    t: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class JoinedSignal:
    """One channel of R runs, run after run: t (N,) s by each run's own clock, y (N,) channel unit; first, end (R,) the
    samples of each run; offset (R,) s, by which its clock is shifted to make `line` (N,) s increase throughout."""

    t: np.ndarray
    y: np.ndarray
    first: np.ndarray
    end: np.ndarray
    offset: np.ndarray
    line: np.ndarray


class Signals(Mapping[tuple[int, str], Signal]):
    """Signals by run and channel; immutable."""

    def __init__(self, signals: Mapping[tuple[int, str], Signal]) -> None:
        self._signals = dict(signals)
        self._joined: dict[str, JoinedSignal | None] = {}

    def __getitem__(self, key: tuple[int, str]) -> Signal:
        return self._signals[key]

    def __iter__(self) -> Iterator[tuple[int, str]]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)

    def joined(self, channel: str) -> JoinedSignal | None:
        """A channel of all runs; None where no run has it."""
        if channel not in self._joined:
            self._joined[channel] = self._join(channel)
        return self._joined[channel]

    def _join(self, channel: str) -> JoinedSignal | None:
        mine = {i: s for (i, c), s in self._signals.items() if c == channel and len(s.t)}
        if not mine:
            return None
        count, length = np.zeros(1 + max(mine), dtype=int), np.zeros(1 + max(mine))
        for i, s in mine.items():
            count[i], length[i] = len(s.t), s.t[-1] - s.t[0]
        end = np.cumsum(count)
        begins = np.cumsum(length + APART) - length  # on the common line, s
        offset = np.array([begins[i] - mine[i].t[0] if i in mine else 0.0 for i in range(len(count))])
        ordered = [mine[i] for i in sorted(mine)]
        t, y = (np.concatenate([getattr(s, x) for s in ordered]).astype(float) for x in ("t", "y"))
        return JoinedSignal(t, y, end - count, end, offset, t + np.repeat(offset, count))
