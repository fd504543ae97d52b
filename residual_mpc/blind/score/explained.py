"""Why answers were wrong, as `blind explain` found it and as the page shows it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from residual_mpc.blind.score.claim import Name
from residual_mpc.blind.score.outcome import Outcome
from residual_mpc.blind.score.tables import Table, names, number
from residual_mpc.errors import BadInput

EXPLAINED = "explain.json"
MEANING: Mapping[str, str] = {
    "search": "right once told which effects to consider",
    "fit": "wrong even so; the planted effects, with the values that they have, predict better than the fit",
    "model": "wrong even so; under the library's laws even the best values of the planted effects leave a large gap",
    "background": "the same, and with the faint background effects added the gap is small",
    "judgement": "wrong even so, though the fit predicts as well as the planted effects do",
    "not measured": "wrong even so; the gaps of the planted effects cannot be measured",
    "false alarm": "the robot has no gap",
    "stand-in": "the library lacks the cause, and another effect was taken for all of it",
    "unseen": "the library lacks the cause, and no gap was seen",
    "failed": "no diagnosis came out, told or not",
}


@dataclass(frozen=True)
class Explained:
    """One wrong answer.

    only: the verdict and the names when only the planted effects were candidates; None where that was not tried or
    failed. gaps, on the held-out windows of that diagnosis: "nominal", "noise floor", "said", "only", "drawn" (the
    planted values), "best fit" (the closest values under the library's laws) and "with background", as far as there
    are such. fault: a key of MEANING.
    """

    case: str
    family: str
    level: str
    seed: int
    planted: tuple[Name, ...]
    said: str | None
    named: tuple[Name, ...]
    only: str | None
    only_named: tuple[Name, ...]
    gaps: Mapping[str, float]
    fault: str
    trouble: str = ""

    def document(self) -> dict[str, Any]:
        """As plain JSON values."""
        return asdict(self)


def answer_of(o: Outcome) -> tuple[str | None, tuple[Name, ...]]:
    """The verdict and the names of an answer; None without a diagnosis."""
    return (None, ()) if o.claim is None else (o.claim.verdict, o.claim.named)


def explained_from(document: Mapping[str, Any]) -> Explained:
    """What `Explained.document` wrote."""
    d = dict(document)
    for key in ("planted", "named", "only_named"):
        d[key] = tuple((str(effect), target) for effect, target in d[key])
    return Explained(**d)


def read_explained(folder: Path) -> tuple[Explained, ...]:
    """The wrong answers that `blind explain` wrote to ``folder``."""
    path = folder / EXPLAINED
    try:
        return tuple(explained_from(d) for d in json.loads(path.read_text())["explain"]["wrong"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(
            f"this folder contains no explained answers ({error!r})",
            str(path),
            "run `residual-mpc blind explain` first",
        ) from None


def faults(explained: tuple[Explained, ...]) -> dict[str, int]:
    """How many answers each kind of fault explains, in the order of MEANING."""
    return {k: n for k in MEANING if (n := sum(e.fault == k for e in explained))}


def table(explained: tuple[Explained, ...]) -> Table:
    """One row a wrong answer."""
    gaps = ("noise floor", "nominal", "said", "only", "drawn", "best fit", "with background")
    shown = [name for name in gaps if any(name in e.gaps for e in explained)]
    columns = ("case", "level", "planted", "said", "with --only", *(f"gap: {name}" for name in shown), "fault")
    rows = [
        (
            e.case, f"{e.family}, {e.level}, {e.seed}", names(e.planted) or "nothing", _answer(e.said, e.named),
            _answer(e.only, e.only_named), *(number(e.gaps.get(name)) for name in shown), e.fault,
        )
        for e in explained
    ]  # fmt: skip
    return Table(columns, tuple(rows))


def _answer(verdict: str | None, named: tuple[Name, ...]) -> str:
    if verdict is None:
        return "–"
    return f"{verdict}: {names(named)}" if named else verdict
