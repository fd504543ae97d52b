"""What a watch tells, each with its JSON form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from residual_mpc.diagnosis.results.document import finite


@dataclass(frozen=True)
class Moment:
    """A place in the stream: s since the run's first stamp, and the log's own clock."""

    run: str
    t: float
    clock: float


@dataclass(frozen=True)
class ReferenceReady:
    """The reference stands, and the test begins. p50, p90: quantiles of the windows' own gaps; block:
    windows of a block of the test."""

    source: str
    windows: int
    runs: int
    gap: float
    p50: float
    p90: float
    channels: tuple[str, ...]
    block: int
    hours: float
    false_alarm: float

    kind = "reference"


@dataclass(frozen=True)
class GapFigure:
    """The gap over the last windows. reference: of steady running, None while it is learned; evidence: of a change, an
    alarm from 1 on; unfamiliar: share of windows driven as none of the reference."""

    at: Moment
    gap: float | None
    reference: float | None
    evidence: float
    windows: int
    horizon: float
    unfamiliar: float

    kind = "gap"


@dataclass(frozen=True)
class GapChanged:
    """The gap has changed for certain. what: the channel, or all; grew: else it shrank; gap: of what, since then;
    reference: of what, in steady running that is driven like these windows;
    unlike: share of them that are driven less alike than nine in ten of the reference's own windows."""

    at: Moment
    since: Moment
    what: str
    grew: bool
    gap: float
    reference: float
    windows: int
    unlike: float

    kind = "change"


@dataclass(frozen=True)
class CauseFound:
    """What the comparison of the reference with the stream since the change says. final: whether the cause is not
    looked for again."""

    at: Moment
    since: Moment
    sentence: str
    document: Mapping[str, Any]
    final: bool

    kind = "cause"


@dataclass(frozen=True)
class Trouble:
    """Something that could not be read or done, and that the watch goes on without."""

    message: str

    kind = "warning"


@dataclass(frozen=True)
class Ended:
    """seconds: of the stream in windows; skipped: windows that could not be compared."""

    seconds: float
    windows: int
    skipped: int
    unfamiliar: int
    changes: int
    gap: float | None

    kind = "end"


Event = ReferenceReady | GapFigure | GapChanged | CauseFound | Trouble | Ended


def document_of(event: Event) -> dict[str, Any]:
    """One JSON object; the kind stands first."""
    if isinstance(event, CauseFound):
        kept = ("verdict", "changes", "confounded", "gap", "stretches", "next_experiment")
        told = {k: event.document[k] for k in kept}
        when = {"at": asdict(event.at), "since": asdict(event.since)}
        return {"event": event.kind, **when, "sentence": event.sentence, **told, "final": event.final}
    clean: dict[str, Any] = finite({"event": event.kind, **asdict(event)})
    return clean
