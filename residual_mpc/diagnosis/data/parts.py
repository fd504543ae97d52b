"""A part of the runs in which an effect acts, while it does nothing in the rest."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.data.left_out import SLACK, clear_of

WHOLE = (-np.inf, np.inf)
NOWHERE = (np.inf, -np.inf)

Span = tuple[float, float]
Spans = Mapping[int, Span]  # from and to, s, of each run (its index); nowhere in runs that are not named


class Timed(Protocol):
    """Windows: run (W,) index and start (W,) s of each, and how long they are, s."""

    @property
    def run(self) -> np.ndarray: ...
    @property
    def start(self) -> np.ndarray: ...
    @property
    def horizon(self) -> float: ...


@dataclass(frozen=True)
class Part:
    """where: in which stretches of the runs the effect acts; rest: in which it does not. What lies in neither is not
    known, such as the windows across the instant at which it begins. used: from and to, s, of the windows that were
    used to decide this for held-out runs; they lie in neither."""

    where: Spans
    rest: Spans
    used: Mapping[int, Sequence[Span]] = field(default_factory=dict)

    def inside(self, data: Timed) -> np.ndarray:
        """(W,) bool: the windows that lie in the part."""
        return _within(data, self.where) & self._unused(data)

    def outside(self, data: Timed) -> np.ndarray:
        """(W,) bool: the windows that lie in the rest."""
        return _within(data, self.rest) & self._unused(data)

    def with_run(self, run: int, where: Span | None, rest: Span | None, used: Sequence[Span]) -> "Part":
        """With a run in which the effect acts in one stretch, if any, and does not in another, if any."""
        there, not_there = ({} if span is None else {run: span} for span in (where, rest))
        return Part({**self.where, **there}, {**self.rest, **not_there}, {**self.used, run: used})

    def _unused(self, data: Timed) -> np.ndarray:
        out = np.ones(len(data.run), dtype=bool)
        for run, spans in self.used.items():
            mine = data.run == run
            out[mine] = clear_of(spans, data.start[mine], data.horizon)
        return out


def after(last: tuple[int, float], first: tuple[int, float], runs: int) -> Part:
    """From an instant on, in the order of so many runs. last, first: run and s, up to which the effect does not act and
    from which it does."""
    (a, end), (b, start) = last, first
    later = {b: (start, np.inf), **dict.fromkeys(range(b + 1, runs), WHOLE)}
    return Part(later, {**dict.fromkeys(range(a), WHOLE), a: (-np.inf, end)})


def before(last: tuple[int, float], first: tuple[int, float], runs: int) -> Part:
    """Up to an instant: the reverse of `after`."""
    part = after(last, first, runs)
    return Part(part.rest, part.where)


def in_runs(some: Iterable[int], others: Iterable[int]) -> Part:
    """In some runs, not in others."""
    where, rest = (dict.fromkeys(map(int, runs), WHOLE) for runs in (some, others))
    return Part(where, rest)


def _within(data: Timed, spans: Spans) -> np.ndarray:
    begin, end = np.array([spans.get(int(i), NOWHERE) for i in data.run]).reshape(-1, 2).T
    return np.asarray((data.start >= begin - SLACK) & (data.start + data.horizon <= end + SLACK))


def groups_of(data: Timed, part: Part) -> np.ndarray:
    """(W,) group of each window: 0 inside the part, 1 outside, -1 for what lies in neither."""
    return np.where(part.inside(data), 0, np.where(part.outside(data), 1, -1))


def grouped(data: Dataset, group: np.ndarray) -> Dataset:
    """The windows by their groups (W,), in their order, without those of a negative one."""
    data, group = data.take(group >= 0), group[group >= 0]
    blocks: list[Block] = []
    for b in data.blocks:
        rows = np.arange(b.where.start, b.where.stop)
        for piece in np.split(rows, np.flatnonzero(np.diff(group[rows])) + 1):
            where = slice(int(piece[0]), int(piece[-1]) + 1)
            drive = b.drive.take(np.isin(rows, piece))
            blocks.append(replace(b, where=where, drive=drive, group=int(group[piece[0]])))
    return replace(data, blocks=tuple(blocks))
