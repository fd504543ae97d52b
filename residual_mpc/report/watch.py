"""A watch in words, and as a page that is kept up to date. Both are made from the events' JSON form."""

from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic
from typing import Any

from residual_mpc.files import write_atomically
from residual_mpc.report.figures.history import Point, history_svg
from residual_mpc.report.sections.section import render
from residual_mpc.report.words.numbers import count, number, percent, plain

Document = Mapping[str, Any]  # one event

EVERYTHING = "all channels"
REFRESH = 5.0  # s between two versions of the page, and its reloads
POINTS = 600  # of the history that is drawn; beyond it neighbours are merged
UNLIKE = 0.25  # share of such windows from which the driving may be what changed
MANY = 0.5  # share of unfamiliar windows from which the line says so


def event_lines(event: Document) -> list[str]:
    """An event as lines for a terminal."""
    return [plain(line) for line in _WORDS[event["event"]](event)]


def _reference(e: Document) -> list[str]:
    return [
        f"reference: {e['source']}: {count(e['windows'], 'window')} in {count(e['runs'], 'run')}, gap "
        f"{number(e['gap'])} (median over the windows {number(e['p50'])}, 90th percentile {number(e['p90'])})",
        f"  tested in blocks of {count(e['block'], 'window')}: {', '.join(e['channels'])}; a false alarm in "
        f"{number(e['hours'])} h of such running has a probability of at most {percent(e['false_alarm'])}",
    ]


def _gap(e: Document) -> list[str]:
    ratio = f"{number(e['gap'] / e['reference'])} times the reference" if e["reference"] else "no reference yet"
    strange = f"  {percent(e['unfamiliar'])} of windows driven unlike the reference, not tested"
    return [
        f"{_moment(e['at']):<28} gap {number(e['gap']):<8} {ratio:<26} "
        f"evidence of a change {percent(min(e['evidence'], 1.0))}" + (strange if e["unfamiliar"] >= MANY else "")
    ]


def _change(e: Document) -> list[str]:
    grew = "grown" if e["grew"] else "shrunk"
    what = "the gap" if e["what"] == EVERYTHING else f"the gap of {e['what']}"
    figures = f"from {number(e['reference'])} to {number(e['gap'])}, since about {_moment(e['since'])}"
    if e["unlike"] < UNLIKE:
        return [f"CHANGED: {what} has {grew} for certain, {figures} (told at {_moment(e['at'])})"]
    return [
        f"CHANGED, or driven differently: {what} has {grew} {figures} (told at {_moment(e['at'])}), and "
        f"{percent(e['unlike'])} of the windows since then were driven unlike most of the reference (usually 10 %)"
    ]


def _cause(e: Document) -> list[str]:
    text = e["sentence"]
    if e["verdict"] == "same":
        text = "No effect can be named: the comparison with the reference finds no certain difference."
    more = "" if e["final"] else " Looking again when more has arrived."
    return [f"CAUSE since about {_moment(e['since'])}: {text}{more}"]


def _end(e: Document) -> list[str]:
    total = "" if e["gap"] is None else f", gap {number(e['gap'])}"
    return [
        f"watched {count(e['windows'], 'window')} ({number(e['seconds'] / 60.0)} min){total}: "
        f"{count(e['changes'], 'change')}, {e['skipped']} windows skipped, {e['unfamiliar']} driven unlike the "
        "reference"
    ]


def _moment(at: Document) -> str:
    return f"{at['run']} {number(at['t'], 5)} s"


_WORDS: dict[str, Callable[[Document], list[str]]] = {
    "reference": _reference,
    "gap": _gap,
    "change": _change,
    "cause": _cause,
    "warning": lambda e: [f"warning: {e['message']}"],
    "end": _end,
}


class LivePage:
    """A page that is written anew now and then while events arrive. Its memory is bounded."""

    def __init__(self, path: Path, robot: str, clock: Callable[[], float] = monotonic) -> None:
        self._path, self._robot, self._clock = path, robot, clock
        self._points: list[Point] = []
        self._told: list[str] = []
        self._reference: Document | None = None
        self._state = "watching"
        self._seconds = 0.0
        self._merge = 1  # figures in a point
        self._part: list[Point] = []
        self._written = -REFRESH

    def take(self, event: Document | None) -> None:
        """An event, or None where nothing happened."""
        if event is not None:
            self._remember(event)
        over = event is not None and event["event"] == "end"
        if over or self._clock() - self._written >= REFRESH:
            self._written = self._clock()
            write_atomically(self._path, self.text(over))

    def _remember(self, event: Document) -> None:
        kind = event["event"]
        if kind == "gap":
            self._seconds += event["windows"] * event["horizon"]
            self._part.append(Point(self._seconds, event["gap"], event["reference"], event["evidence"], False))
            if len(self._part) >= self._merge:
                self._points.append(_merged(self._part))
                self._part = []
            if len(self._points) >= POINTS:
                self._points = [_merged(self._points[k : k + 2]) for k in range(0, len(self._points), 2)]
                self._merge *= 2
            return
        if kind == "reference":
            self._reference = event
        if kind == "change":
            self._state = "changed"
            self._points.append(Point(self._seconds, 0.0, None, 1.0, True))
        self._told = [*self._told, *event_lines(event)][-40:]

    def text(self, over: bool) -> str:
        """The page."""
        last = next((p for p in [*self._part[::-1], *self._points[::-1]] if not p.changed), None)
        return str(
            render(
                "watch.html.jinja", robot=self._robot, over=over, refresh=int(REFRESH), state=self._state,
                reference=self._reference, last=last, told=self._told[::-1], svg=history_svg(self._points),
            )
        ) + "\n"  # fmt: skip


def _merged(points: list[Point]) -> Point:
    """Neighbours as one: the largest gap and evidence, so that no peak is lost."""
    gaps = [p.gap for p in points]
    return Point(points[-1].seconds, max(gaps), points[-1].reference, max(p.evidence for p in points),
                 any(p.changed for p in points))  # fmt: skip
