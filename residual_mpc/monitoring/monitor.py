"""The watch: learn a reference, test every window against it, name the cause of a change, and begin anew."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.logs.run import Run
from residual_mpc.monitoring.arrivals.follow import Arrival
from residual_mpc.monitoring.arrivals.rows import RowReader
from residual_mpc.monitoring.arrivals.segments import Segment, Stream
from residual_mpc.monitoring.cause import CauseFinder
from residual_mpc.monitoring.detection import cusum
from residual_mpc.monitoring.detection.change_point import change_point
from residual_mpc.monitoring.detection.exceedance import far_above
from residual_mpc.monitoring.detection.reference import Reference, build_reference
from residual_mpc.monitoring.events import (
    CauseFound,
    Ended,
    Event,
    GapChanged,
    GapFigure,
    Moment,
    ReferenceReady,
    Trouble,
)
from residual_mpc.monitoring.model import WatchedModel
from residual_mpc.monitoring.places import Place, gaps_of
from residual_mpc.monitoring.settings import WatchSettings
from residual_mpc.monitoring.windows import LEAD, new_windows

RECENT = 20_000  # windows whose place in the stream is remembered
BEFORE = 2  # blocks before the sum's last zero, or the stretch of large errors, in which a change may have begun


@dataclass(frozen=True)
class DatedAlarm:
    """An alarm of either test. series: index of what changed; grows: whether its errors grow; windows: since the
    change."""

    series: int
    grows: bool
    windows: int


@dataclass(eq=False)
class Change:
    """A change that was told, whose cause is being looked for. at: the last window; seen: s of the stream since the
    change; attempt: how often its cause was looked for."""

    since: Place
    at: Moment
    seen: float
    attempt: int = 0


@dataclass(eq=False)
class Totals:
    """Windows that were tested, could not be compared, or were driven unlike the reference; and what was told."""

    windows: int = 0
    skipped: int = 0
    unfamiliar: int = 0
    changes: int = 0


class Watch:
    """Memory of a watch; `take` is its step."""

    def __init__(
        self,
        model: WatchedModel,
        cause: CauseFinder,
        columns: Callable[[], RowReader],
        check: Callable[[Run], None],
        noise: Mapping[str, float],
        horizon: float,
        reference: Reference | None,
        rng: np.random.Generator,
        settings: WatchSettings,
    ) -> None:
        self._model, self._cause, self._reader, self._check = model, cause, columns, check
        self._noise, self._horizon, self._rng, self._settings = noise, horizon, rng, settings
        self._readers: dict[str, RowReader] = {}
        self._checked: set[str] = set()
        self._stream = Stream(settings.arrivals)
        self._reference: Reference | None = None
        self._first: tuple[int, float] | None = None  # where the reference that is being learned begins
        self._learned = 0.0  # s of it
        self._begin(reference)
        self._change: Change | None = None
        self._figure: list[tuple[float, bool]] = []  # squared gap and familiarity of the windows since the last figure
        self._total = Totals()
        self._square: deque[float] = deque(maxlen=RECENT)

    def begun(self) -> Iterator[Event]:
        """What is known before anything arrives."""
        if self._reference is not None:
            yield _ready(self._reference)

    def take(self, arrival: Arrival) -> Iterator[Event]:
        """What one arrival tells. Raises BadInput for a log that cannot be read from its beginning, if it is the
        first of all."""
        try:
            reader = self._readers.setdefault(arrival.source, self._reader())
            for rows in reader.read(arrival):
                for segment in self._stream.add(rows):
                    yield from self._grown(segment)
            yield from _left_out(reader, arrival.source)
        except BadInput as error:
            if not self._checked:
                raise
            yield Trouble(str(error))
        while len(self._readers) > self._settings.arrivals.open:
            self._readers.pop(next(iter(self._readers)))
        self._stream.forget(LEAD)

    def end(self) -> Iterator[Event]:
        """The last look for a cause, and the summary."""
        if self._change is not None:
            yield from self._look(final=True)
        n = self._total
        gap = float(np.sqrt(np.mean(self._square))) if self._square else None
        seconds = n.windows * self._horizon
        yield Ended(seconds, n.windows, n.skipped, n.unfamiliar, n.changes, gap)

    def _grown(self, segment: Segment) -> Iterator[Event]:
        if segment.name not in self._checked:
            run = segment.run(segment.first)
            if run is None:
                return
            self._check(run)
            if len(self._checked) > RECENT:
                self._checked.clear()
            self._checked.add(segment.name)
        while len(starts := segment.complete(self._horizon)):
            if self._reference is None:
                yield from self._learn(segment, len(starts))
            else:
                yield from self._test(segment, starts[: max(1, round(self._settings.every / self._horizon))])

    def _learn(self, segment: Segment, windows: int) -> Iterator[Event]:
        """Take windows into the reference, until it is long enough."""
        if self._first is None:
            self._first = (segment.number, segment.due)
        left = int(np.ceil((self._settings.learn - self._learned) / self._horizon - 1e-9))
        taken = min(windows, left)
        segment.due += taken * self._horizon
        self._learned += taken * self._horizon
        if taken < left:
            return
        runs = self._stream.since(*self._first)
        if runs and runs[-1].name == segment.name:  # what follows is to be tested, not learned
            last = runs[-1]
            n = int(np.searchsorted(last.t, segment.due + 0.5 * segment.period))
            if n >= 2:
                columns = {k: v[:n] for k, v in last.columns.items()}
                runs[-1] = Run(last.name, last.t[:n], columns, last.served_as_command, source=last.source)
        minutes = self._learned / 60.0
        try:
            described = f"the {'first ' if not self._total.windows else ''}{minutes:.3g} min of the stream"
            found = build_reference(
                runs, self._model, self._noise, self._horizon, described, self._rng, self._settings.detection
            )
        except BadInput as error:
            yield Trouble(f"no reference yet: {error}")
            self._begin(None)
            return
        self._begin(found)
        yield _ready(found)

    def _begin(self, reference: Reference | None) -> None:
        """Test against a reference; without one, learn it first."""
        self._reference, self._first, self._learned = reference, None, 0.0
        self._places: deque[Place] = deque(maxlen=RECENT)
        self._block: list[np.ndarray] = []  # scores of the block that is being filled
        self._rest: deque[np.ndarray] = deque(maxlen=self._settings.detection.large_windows)  # of the last windows
        if reference is not None:
            self._sums = cusum.init(len(reference.thresholds.allowances), len(reference.series))

    def _test(self, segment: Segment, starts: np.ndarray) -> Iterator[Event]:
        assert self._reference is not None
        segment.due = float(starts[-1] + self._horizon)
        run = segment.run(float(starts[0]) - LEAD)
        r = self._reference
        windows = None if run is None else new_windows(
            run, starts, self._model, self._noise, self._horizon, r.names, r.scales
        )  # fmt: skip
        self._total.skipped += len(starts) - (0 if windows is None else len(windows))
        if windows is None:
            return
        scored = r.scored(windows)
        for k, t in enumerate(windows.start):
            error, scores, familiar = scored.error[k], scored.scores[k], bool(scored.familiar[k])
            if not np.isfinite(error[0]):
                self._total.skipped += 1
                continue
            at = Moment(segment.name, float(t + self._horizon), segment.begun + float(t + self._horizon))
            begun = Moment(segment.name, float(t), segment.begun + float(t))
            self._places.append(Place(segment.number, begun, error, scored.rest[k], scores, bool(scored.far[k])))
            self._block.append(scores)
            self._rest.append(scored.rest[k])
            self._total.windows += 1
            self._total.unfamiliar += not familiar
            self._square.append(float(error[0]))
            yield from self._told(at, float(error[0]), familiar)
            if self._reference is not r:  # the robot changed, and a new reference is being learned
                segment.due = float(t + self._horizon)
                return

    def _told(self, at: Moment, square: float, familiar: bool) -> Iterator[Event]:
        """A window was tested."""
        r = self._reference
        assert r is not None
        block_ends = len(self._block) >= r.block
        if block_ends:
            self._sums = cusum.step(self._sums, r.standardised(np.array(self._block)), r.thresholds)
            self._block.clear()
        found = self._alarm(r, block_ends) if self._change is None else None
        self._figure.append((square, familiar))
        if found is not None or len(self._figure) * self._horizon >= self._settings.every - 1e-9:
            squares, known = np.array(self._figure).T
            evidence = max(cusum.evidence(self._sums, r.thresholds), 0.0 if found is None else 1.0)
            now, strange = float(np.sqrt(squares.mean())), float(1.0 - known.mean())
            yield GapFigure(at, now, r.gap, evidence, len(squares), self._horizon, strange)
            self._figure.clear()
        if found is not None:
            yield self._changed(at, found, r)
        elif self._change is not None:
            self._change.at = at
            self._change.seen += self._horizon
        if self._change is not None:
            due = sum(self._change.seen >= seconds for seconds in self._settings.attempts)
            if due > self._change.attempt:
                self._change.attempt = due
                yield from self._look(final=due == len(self._settings.attempts))

    def _alarm(self, r: Reference, block_ends: bool) -> DatedAlarm | None:
        """What the last windows, or at its end the last block, tell for certain."""
        large = far_above(np.array(self._rest), r.limits, r.settings)
        found = cusum.alarm(self._sums, r.thresholds) if block_ends and large is None else None
        if large is not None:
            series, grows, began = large, True, r.settings.large_windows
        elif found is not None:
            series, grows, began = found.series, found.grows, (self._sums.count - found.since) * r.block
        else:
            return None
        scores = np.array([p.scores[series] for p in list(self._places)[-began - BEFORE * r.block :]])
        off = (scores - r.centre[series]) * (1.0 if grows else -1.0)
        return DatedAlarm(series, grows, len(scores) - change_point(off))

    def _changed(self, at: Moment, found: DatedAlarm, r: Reference) -> GapChanged:
        since = list(self._places)[-max(min(found.windows, len(self._places)), 1) :]
        self._change = Change(since[0], at, len(since) * self._horizon)
        self._total.changes += 1
        now, usual = gaps_of(since, found.series, r.rest[:, found.series])
        unlike = float(np.mean([p.far for p in since]))
        return GapChanged(at, since[0].moment, r.series[found.series], found.grows, now, usual, len(since), unlike)

    def _look(self, final: bool) -> Iterator[Event]:
        """Compare the reference with the stream since the change."""
        change, r = self._change, self._reference
        assert change is not None and r is not None
        after = self._stream.since(change.since.segment, change.since.moment.t)
        try:
            document = self._cause.find(r.runs, after, self._rng)
        except BadInput as error:
            yield Trouble(f"the cause cannot be looked for: {error}")
        else:
            final = final or document["verdict"] == "changed"
            yield CauseFound(change.at, change.since.moment, document["verdict_sentence"], document, final)
        if final:
            self._change = None
            self._begin(None)  # the robot is another one now: learn what is steady anew


def watch(
    arrivals: Iterable[Arrival | None], of: Watch, stopped: Callable[[], bool] = lambda: False
) -> Iterator[Event | None]:
    """The events of a stream, and its summary where it ends or is stopped; None while nothing arrives."""
    yield from of.begun()
    for arrival in arrivals:
        if stopped():
            break
        if arrival is None:
            yield None
        else:
            yield from of.take(arrival)
    yield from of.end()


def _left_out(reader: RowReader, source: str) -> Iterator[Trouble]:
    """What is said of lines that a reader left out, which it then forgets."""
    lines, reader.left_out = reader.left_out, []
    if lines:
        some = "1 row was" if len(lines) == 1 else f"{len(lines)} rows were"
        yield Trouble(f"{source}: {some} left out, such as {lines[0][:60]!r}: a cell is missing or is not a number")


def _ready(r: Reference) -> ReferenceReady:
    windows = np.sqrt(r.error[:, 0])
    p50, p90 = (float(q) for q in np.quantile(windows, (0.5, 0.9)))
    tuned = r.settings
    return ReferenceReady(r.described, len(windows), len(r.runs), r.gap, p50, p90, r.channels, r.block,
                          tuned.hours, tuned.false_alarm)  # fmt: skip
