"""What a blind case hides: the planted effects, and the answer that is sealed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Planted:
    """One effect that the truth has.

    Parameters are in the units of the effect table and mean what the table says, though the truth may follow
    another law (its constants are then those of the law's closest member). ``ratio`` is what the effect alone
    adds to the one-second gap, over the noise floor.
    """

    effect: str
    target: str | None
    parameters: Mapping[str, float]
    ratio: float = float("nan")


@dataclass(frozen=True)
class Answer:
    """The truth of one case. It is sealed, and kept apart from the case until it is revealed."""

    case: str
    family: str
    level: str
    seed: int
    effects: tuple[Planted, ...]
    # naming one is no error: faint effects, one that comes and goes, or (without parameters) what describes a part of
    # an unknown cause
    background: tuple[Planted, ...] = ()
    unknown: tuple[str, ...] = ()  # causes that no library names; with effects: beside them
    withheld: tuple[str, ...] = ()  # library effects whose candidate the diagnosis may not use
    twins: tuple[tuple[str, ...], ...] = ()  # per effect: the names that such data cannot part from it
    traits: tuple[str, ...] = ()  # what the runs are like, as the list of twins speaks of it
    notes: Mapping[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """The answer as plain JSON values."""
        return asdict(self)


def answer_from(document: Mapping[str, Any]) -> Answer:
    """The answer that ``document`` (see ``Answer.document``) holds."""
    d = dict(document)
    for name in ("effects", "background"):
        d[name] = tuple(Planted(**p) for p in d.get(name, ()))
    for name in ("unknown", "withheld", "traits"):
        d[name] = tuple(d.get(name, ()))
    d["twins"] = tuple(tuple(t) for t in d.get("twins", ()))
    return Answer(**d)
