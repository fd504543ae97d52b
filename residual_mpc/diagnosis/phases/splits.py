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


def with_held_runs(line: Timeline, split: Split, free: np.ndarray, inside: np.ndarray, outside: np.ndarray) -> Split:
    """The split with the runs of which no fit has seen any window, free (W,) bool, and of which it is not known whether
    they lie in the part: by the squared errors (W,) of every other window, which is then no longer judged. In a run
    between the two sides the effects may begin or end."""
    part, known = split.part, sorted({*split.part.where, *split.part.rest})
    for i in np.unique(line.run):
        mine = np.flatnonzero(line.run == i)
        told = (part.inside(line) | part.outside(line))[mine]
        if free[mine].any() or told.any() or len(mine) < 2:
            continue
        used = mine[::2]
        gain = outside[used] - inside[used]  # by the effects
        spans = [(float(line.start[k]), float(line.start[k] + line.horizon)) for k in used]
        sides = [[j for j in known if (j in split.part.where) == acts] for acts in (split.begins, not split.begins)]
        between = split.at is not None and max(sides[1]) < i < min(sides[0])
        part = part.with_run(int(i), *_acting(gain, spans, split.begins, between), spans)
    return replace(split, part=part)


def _acting(gain: np.ndarray, spans: Sequence[Span], begins: bool, between: bool) -> tuple[Span | None, Span | None]:
    """From and to, s, where effects act in a run and where they do not, by what they gain (n,) in each of these spans:
    all along or nowhere, or in a run between the sides of an instant maybe from or up to one."""
    whole = float(gain.sum())
    if between:
        early = np.cumsum(gain)[:-1]
        saved = whole - early if begins else early
        k = int(np.argmax(saved))
        if saved[k] > max(whole, 0.0):
            first, then = (-np.inf, spans[k][1]), (spans[k + 1][0], np.inf)
            return (then, first) if begins else (first, then)
    return (WHOLE, None) if whole > 0.0 else (None, WHOLE)


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
