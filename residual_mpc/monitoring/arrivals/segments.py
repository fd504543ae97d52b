"""The rows that arrived, as segments without long pauses; of an endless stream only the last stay in memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from residual_mpc.logs.run import Run
from residual_mpc.monitoring.arrivals.rows import Rows, stacked
from residual_mpc.monitoring.settings import ArrivalSettings


@dataclass
class Segment:
    """Rows of one run without a long pause.

    number: its place in the stream; begun: s, the run's first stamp by the log's own clock, from which all times count;
    due: s, where its next window starts; period: s between rows.
    """

    number: int
    begun: float
    due: float
    period: float
    parts: list[Rows]

    @property
    def name(self) -> str:
        return self.parts[-1].name

    @property
    def first(self) -> float:
        return float(self.parts[0].stamps[0] - self.begun)

    @property
    def last(self) -> float:
        return float(self.parts[-1].stamps[-1] - self.begun)

    def add(self, rows: Rows) -> None:
        self.parts.append(rows)
        if len(rows) > 2:
            self.period = float(np.median(np.diff(rows.stamps)))

    def complete(self, horizon: float) -> np.ndarray:
        """(W,) s: starts of the windows that are complete and were not taken yet."""
        n = int(np.floor((self.last - self.due + self.period) / horizon + 1e-6))
        return np.asarray(self.due + horizon * np.arange(max(n, 0)))

    def run(self, t: float, name: str = "") -> Run | None:
        """Its rows from t (s) on, None where there are fewer than two."""
        parts = [p for p in self.parts if p.stamps[-1] - self.begun >= t - 1e-9]
        if not parts:
            return None
        rows = stacked(parts)
        rows = rows.take(int(np.searchsorted(rows.stamps, self.begun + t - 1e-9)), len(rows))
        if len(rows) < 2:
            return None
        return Run(name or rows.name, rows.stamps - self.begun, rows.columns, rows.served_as_command,
                   source=rows.source, start=self.begun)  # fmt: skip

    def forget(self, t: float) -> None:
        """Let go of rows before t (s), part by part; the last stays."""
        self.parts = [p for p in self.parts[:-1] if p.stamps[-1] - self.begun >= t] + self.parts[-1:]


@dataclass
class Stream:
    """All segments that are in memory, in the order in which they began."""

    settings: ArrivalSettings
    segments: list[Segment] = field(default_factory=list)
    _open: dict[tuple[str, str], Segment] = field(default_factory=dict)
    _count: int = 0

    def add(self, rows: Rows) -> Iterator[Segment]:
        """Append new rows to their run, and yield the segments that grew."""
        key = (rows.source, rows.name)
        last = self._open.get(key)
        if last is not None:
            end = last.begun + last.last
            if rows.stamps[0] < end - self.settings.back:  # the clock was set back, or the log begins anew
                last, rows = None, rows.take(0, int(np.searchsorted(rows.stamps, end - 1e-9)))
            else:
                rows = rows.take(int(np.searchsorted(rows.stamps, end + 1e-9, side="right")), len(rows))
        if not len(rows):
            return
        begun = float(rows.stamps[0]) if last is None else last.begun
        period = float(np.median(np.diff(rows.stamps))) if len(rows) > 2 else (last.period if last else 0.0)
        pause = max(self.settings.pause, self.settings.pause_periods * period)
        edges = [0, *(np.flatnonzero(np.diff(rows.stamps) > pause) + 1), len(rows)]
        for a, b in zip(edges[:-1], edges[1:], strict=True):
            piece = rows.take(a, b)
            if last is not None and piece.stamps[0] - begun - last.last <= pause:
                last.add(piece)
            else:
                self._count += 1
                last = Segment(self._count, begun, float(piece.stamps[0] - begun), period, [piece])
                self.segments.append(last)
            self._remember(key, last)
            yield last

    def _remember(self, key: tuple[str, str], segment: Segment) -> None:
        self._open.pop(key, None)
        self._open[key] = segment
        while len(self._open) > self.settings.open:
            self._open.pop(next(iter(self._open)))

    def forget(self, lead: float) -> None:
        """Let go of what is older than `kept` s of the stream; lead: s that stay before a window that is due."""
        left, kept = self.settings.kept, []
        open_ones = {s.number for s in self._open.values()}
        for segment in reversed(self.segments):
            length = segment.last - segment.first
            if length > left:
                segment.forget(min(segment.last - max(left, 0.0), segment.due - lead))
            if left > 0.0 or segment.number in open_ones:
                kept.append(segment)
            left -= length
        self.segments = kept[::-1]

    def since(self, number: int, t: float) -> list[Run]:
        """What arrived from a place in the stream on: a segment and s in it."""
        later = [s for s in self.segments if s.number >= number]
        runs = [s.run(t if s.number == number else s.first) for s in later]
        return [run for run in runs if run is not None]
