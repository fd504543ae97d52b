"""Parts of the runs in which effects may act alone, where an explanation of all runs leaves much."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.parts import WHOLE, Part, Span, after, before, in_runs
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.phases.remaining import compared, window_errors
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import PartSettings
from residual_mpc.diagnosis.results.variation import variations_in_fits
from residual_mpc.diagnosis.results.variation_records import Instant, Variation
from residual_mpc.logs.run import Run


@dataclass(frozen=True, eq=False)
class Timeline:
    """Windows in the order of the runs and of time: run (W,) index, start (W,) s."""

    runs: tuple[Run, ...]
    run: np.ndarray
    start: np.ndarray
    horizon: float


def timeline_of(data: Dataset) -> tuple[Timeline, np.ndarray]:
    """The windows in order, and their numbers (W,) in the dataset, where those of several robots lie apart."""
    order = np.lexsort((data.start, data.run))
    return Timeline(data.runs, data.run[order], data.start[order], data.horizon), order


@dataclass(frozen=True)
class Split:
    """A part of the runs. at: it begins or ends before this window, in the order of time, None where it is not one
    stretch of time; begins: whether the effects begin there or end."""

    part: Part
    at: int | None = None
    begins: bool = True

    def variation(self, runs: Sequence[Run]) -> Variation | None:
        """How an effect that acts in the part alone varies; None where it acts in some runs between others."""
        where, rest = self.part.where, self.part.rest
        both = sorted(where.keys() & rest.keys())
        if both:  # the run in which it begins or ends
            run = both[0]
            edges = (rest[run][1], where[run][0]) if self.begins else (where[run][1], rest[run][0])
            at = Instant(runs[run].name, 0.5 * (edges[0] + edges[1]))
            return Variation(since=at) if self.begins else Variation(until=at)
        for early, late, begins in ((rest, where, True), (where, rest, False)):
            if max(early) < min(late):
                at = Instant(runs[min(late)].name, float(runs[min(late)].t[0]))
                return Variation(since=at) if begins else Variation(until=at)
        return None


def splits(prepared: Prepared, refined: Refined) -> list[Split]:
    """The likeliest first: from or up to the instant at which a named effect begins or ends, and where the gap is far
    larger than in the rest."""
    of, settings, data = refined.explanation, prepared.options.settings, prepared.fitting
    data = data.take(compared(data))
    line, order = timeline_of(data)
    out: list[Split] = []
    for variation in variations_in_fits(of, settings).values() if of.final.terms else ():
        instant = variation.since or variation.until
        if instant is not None:
            run = [r.name for r in line.runs].index(instant.run)
            earlier = (line.run < run) | ((line.run == run) & (line.start + 0.5 * line.horizon < instant.t))
            out += _at(line, int(earlier.sum()), variation.since is not None)
    for values in (of.base.values, of.final.values):
        square = window_errors(data, prepared.scales, predict(data, prepared.space.settings([values]))[0])
        out += _by_level(line, square[order], settings.parts)
    distinct: list[Split] = []
    for split in out:
        enough = min(split.part.inside(line).sum(), split.part.outside(line).sum()) >= settings.parts.fewest
        if enough and not any(_alike(line, split.part, s.part) for s in distinct):
            distinct.append(split)
    return distinct


def sharpened(line: Timeline, split: Split, inside: np.ndarray, outside: np.ndarray, settings: PartSettings) -> Split:
    """The split at the instant that suits squared errors (W,) with the effects and without them best; windows next to
    it that neither suits lie across it, and belong to neither side."""
    if split.at is None:
        return split
    early, late = (outside, inside) if split.begins else (inside, outside)
    places = np.arange(settings.fewest, len(line.run) - settings.fewest + 1)
    if not len(places):
        return split
    costs = [float(early[:n].sum() + late[n:].sum()) for n in places]
    n = int(places[int(np.argmin(costs))])
    most = settings.crossing * float(np.median(np.concatenate([early[:n], late[n:]])))
    lost = (int(early[n - 1] > most), int(late[n] > most))
    return next(iter(_at(line, n, split.begins, *lost)), split)


def with_held_runs(
    line: Timeline, split: Split, free: np.ndarray, inside: np.ndarray, outside: np.ndarray, settings: PartSettings
) -> Split:
    """The split with the runs of which no fit has seen any window, free (W,) bool, and of which it is not known whether
    they lie in the part.

    The squared errors (W,) in the first half of a run decide. In runs between the two sides of an instant, those of
    every other window do: the effects may begin or end there. Windows that were used for this are not judged.
    """
    part, held = split.part, [int(i) for i in np.unique(line.run) if _is_unknown(line, split.part, free, int(i))]
    early, late = (part.rest, part.where) if split.begins else (part.where, part.rest)
    between = [i for i in held if split.at is not None and max(early) < i < min(late)]
    used = {i: _used(np.flatnonzero(line.run == i), i in between) for i in held}
    spans = {i: [(float(line.start[k]), float(line.start[k] + line.horizon)) for k in used[i]] for i in held}
    gain = {i: outside[used[i]] - inside[used[i]] for i in held}  # by the effects
    for i in (i for i in held if i not in between):
        acts = bool(gain[i].sum() > 0.0)
        part = part.with_run(i, WHOLE if acts else None, None if acts else WHOLE, spans[i])
    if between:
        cut = _cut([gain[i] for i in between], split.begins, settings)
        for i in between:
            k = int(np.clip(cut, 0, len(spans[i])))
            cut -= len(spans[i])
            first, then = _cut_at(spans[i], k)
            where, rest = (then, first) if split.begins else (first, then)
            part = part.with_run(i, where, rest, spans[i])
    return replace(split, part=part)


def _is_unknown(line: Timeline, part: Part, free: np.ndarray, run: int) -> bool:
    """Whether no fit has seen any window of a run of at least two, and the part does not say whether it lies in it."""
    mine = line.run == run
    told = part.inside(line) | part.outside(line)
    return int(mine.sum()) >= 2 and not (free | told)[mine].any()


def _used(mine: np.ndarray, between: bool) -> np.ndarray:
    """The windows of a held-out run (n,) that decide where it lies."""
    return mine[::2] if between else mine[: len(mine) // 2]


def _cut(gains: Sequence[np.ndarray], begins: bool, settings: PartSettings) -> int:
    """Before which of the windows of some runs, one after the other, the effects begin or end, by what they gain in
    each; before the first or after the last unless another instant is clearly better."""
    gain = np.concatenate(gains)
    early = np.concatenate([[0.0], np.cumsum(gain)])
    saved = early[-1] - early if begins else early
    k = int(np.argmax(saved))
    ends = max(saved[0], saved[-1])
    clear = saved[k] - ends > settings.dated * float(np.sqrt(np.sum(gain**2)))
    return k if clear else (0 if saved[0] >= saved[-1] else len(gain))


def _cut_at(spans: Sequence[Span], k: int) -> tuple[Span | None, Span | None]:
    """From and to, s, before and after the window k of a run; None for a side that the run does not reach."""
    if k == 0:
        return None, WHOLE
    if k == len(spans):
        return WHOLE, None
    return (-np.inf, spans[k - 1][1]), (spans[k][0], np.inf)


def _at(line: Timeline, n: int, begins: bool, lost_before: int = 0, lost_after: int = 0) -> list[Split]:
    """The split before a window of these; so many windows on either side of it belong to neither. None at an end."""
    last, first = n - 1 - lost_before, n + lost_after
    if not 0 <= last < first < len(line.run):
        return []
    ends = (int(line.run[last]), float(line.start[last] + line.horizon))
    starts = (int(line.run[first]), float(line.start[first]))
    if ends[0] == starts[0]:
        return [Split((after if begins else before)(ends, starts, len(line.runs)), n, begins)]
    sides = [np.unique(line.run[: last + 1]), np.unique(line.run[first:])]
    return [Split(in_runs(*(reversed(sides) if begins else sides)), n, begins)]


def _by_level(line: Timeline, square: np.ndarray, settings: PartSettings) -> list[Split]:
    """The split in time, and that between the runs, at which the logarithm of the windows' squared gaps (W,) changes
    most, where it changes beyond doubt."""
    level, runs = np.log(np.maximum(square, 1e-12)), np.unique(line.run)
    out: list[Split] = []
    every = np.arange(settings.fewest, len(line.run) - settings.fewest + 1)
    if (step := _step(level, every, settings)) is not None:
        out += _at(line, *step)
    ranked = runs[np.argsort([level[line.run == i].mean() for i in runs])]
    ends = np.cumsum([np.count_nonzero(line.run == i) for i in ranked])[:-1]
    step = _step(np.concatenate([level[line.run == i] for i in ranked]), ends, settings)
    if step is not None:
        first = int(np.searchsorted(ends, step[0])) + 1
        out.append(Split(in_runs(ranked[first:], ranked[:first])))
    return out


def _step(level: np.ndarray, places: np.ndarray, settings: PartSettings) -> tuple[int, bool] | None:
    """At which of these places the mean of a sequence (n,) changes most, and whether it rises there; None where it does
    not change beyond doubt, and by enough."""
    places = places[(places >= settings.fewest) & (places <= len(level) - settings.fewest)]
    if not len(places):
        return None
    sums = np.cumsum(level)
    early, late = sums[places - 1] / places, (sums[-1] - sums[places - 1]) / (len(level) - places)
    k = int(np.argmax(places * (len(level) - places) * (late - early) ** 2))
    n, change = int(places[k]), float(late[k] - early[k])
    spread = np.sum((level[:n] - early[k]) ** 2) + np.sum((level[n:] - late[k]) ** 2)
    between = n * (len(level) - n) / len(level) * change**2
    clear = between > settings.beyond_doubt * max(float(spread) / len(level), 1e-12)
    return (n, change > 0.0) if clear and abs(change) > 2.0 * np.log(settings.times) else None


def _alike(line: Timeline, one: Part, other: Part) -> bool:
    """Whether two parts differ by a few windows at most."""
    return int(np.count_nonzero(one.inside(line) != other.inside(line))) <= 2
