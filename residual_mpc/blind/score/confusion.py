"""The confusion matrix: planted against named effects, over the cases of every level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.blind.score.outcome import Outcome
from residual_mpc.blind.score.strict import to_find

NOTHING = "(no gap)"
BACKGROUND = "(extra, in the background)"
EXTRA = "(extra, not there)"


@dataclass(frozen=True, eq=False)
class Confusion:
    """rows: what was planted, columns: what was named, in round brackets where it is no effect of the library;
    counts (rows, columns)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: np.ndarray

    def lines(self) -> list[str]:
        """One line a row, the columns by falling count."""
        found = []
        for row, counts in zip(self.rows, self.counts, strict=True):
            order = sorted(np.flatnonzero(counts), key=lambda j: (-counts[j], self.columns[j]))
            found.append(f"{row}: " + ", ".join(f"{self.columns[j]} {counts[j]:.0f}" for j in order))
        return found


def confusion(outcomes: Sequence[Outcome]) -> Confusion:
    """Every effect as it is named, without an exchange of group members. An effect that was missed is counted with
    each named effect that was not planted, else with the verdict; where none was missed, the effects that were not
    planted have a row of their own."""
    pairs = [pair for o in outcomes for pair in _pairs(o)]
    planted, named = {a for a, _ in pairs}, {b for _, b in pairs}
    rows = sorted(planted, key=_last)
    own = [r for r in rows if not r.startswith("(")]
    columns = [*own, *sorted(named - set(own), key=_last)]
    counts = np.zeros((len(rows), len(columns)))
    for a, b in pairs:
        counts[rows.index(a), columns.index(b)] += 1
    return Confusion(tuple(rows), tuple(columns), counts)


def _pairs(o: Outcome) -> list[tuple[str, str]]:
    causes = list(to_find(o.answer))
    if o.answer.withheld:
        causes = [f"(withheld) {p.effect}" for p in o.answer.effects]
    elif o.answer.unknown:
        causes = [f"(unknown) {cause}" for cause in o.answer.unknown]
    if o.claim is None:
        return [(cause, "(failed)") for cause in causes or [NOTHING]]
    named = list(dict.fromkeys(effect for effect, _ in o.claim.named))
    verdict = NOTHING if o.claim.verdict == "no_gap" else f"({o.claim.verdict})"
    other = [effect for effect in named if effect not in causes]
    if not causes:
        return [(NOTHING, effect) for effect in named or [verdict]]
    missed = [cause for cause in causes if cause not in named]
    pairs = [(cause, cause) for cause in causes if cause in named]
    pairs += [(cause, effect) for cause in missed for effect in other or [verdict]]
    if not missed:
        pairs += [(EXTRA if effect in o.strict.wrong else BACKGROUND, effect) for effect in other]
    return pairs


def _last(name: str) -> tuple[int, str]:
    """Effects first, then what the library lacks, then the rest."""
    return (0 if not name.startswith("(") else 1 if ") " in name else 2), name
