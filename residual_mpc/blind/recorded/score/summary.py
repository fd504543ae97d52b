"""The figures of one method on a suite of recorded runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from residual_mpc.blind.recorded.score.match import lacking
from residual_mpc.blind.recorded.score.outcome import Outcome
from residual_mpc.blind.score.rates import Rate, rate

NONE = "none"
VISIBLE = {True: "above", False: "below"}  # the smallest change that the runs were said to show


@dataclass(frozen=True)
class Summary:
    """See `figures` in the page for what each rate counts."""

    method: str
    outcomes: tuple[Outcome, ...]
    right: Rate
    strict: Rate
    target_right: Rate
    right_on_changed: Rate
    same_on_none: Rate
    same_on_changed: Rate
    lacking: Rate
    size_error: float | None
    interval_coverage: Rate
    surest_wrong: float | None
    sure_and_wrong: Rate
    by_source: Mapping[str, Rate]  # right
    by_number: Mapping[str, Rate]  # right, by the number of changes
    by_kind: Mapping[str, Rate]  # planted changes that are named
    by_dose: Mapping[str, Rate]  # planted changes that are named
    by_visible: Mapping[str, Rate]  # the same, by whether the runs were said to show a change of that size
    right_by_kind: Mapping[str, Rate]  # of the cases with one change
    right_by_dose: Mapping[str, Rate]
    seconds: float | None
    failed: int

    def document(self) -> dict[str, object]:
        """As plain JSON values."""
        return {
            "method": self.method, "cases": len(self.outcomes), "failed": self.failed,
            "right": self.right.document(), "strict": self.strict.document(),
            "target_right": self.target_right.document(), "right_on_changed": self.right_on_changed.document(),
            "same_on_none": self.same_on_none.document(),
            "same_on_changed": self.same_on_changed.document(), "lacking_right": self.lacking.document(),
            "median_size_error": self.size_error, "interval_coverage": self.interval_coverage.document(),
            "highest_wrong_probability": self.surest_wrong, "wrong_stated_at_0.9": self.sure_and_wrong.document(),
            **{
                name: {key: each.document() for key, each in rates.items()}
                for name, rates in (
                    ("by_source", self.by_source), ("by_number", self.by_number), ("named_by_kind", self.by_kind),
                    ("named_by_dose", self.by_dose), ("named_by_visible", self.by_visible),
                    ("right_by_kind", self.right_by_kind), ("right_by_dose", self.right_by_dose),
                )
            },
            "median_seconds": self.seconds,
            "outcomes": [_row(o) for o in self.outcomes],
        }  # fmt: skip


def _row(o: Outcome) -> dict[str, object]:
    return {
        "case": o.name, "source": o.source, "dose": o.answer.notes["dose"],
        "changed": [{"effect": p.effect, "target": p.target, "parameters": dict(p.parameters)}
                    for p in o.answer.effects],
        "verdict": None if o.claim is None else o.claim.verdict,
        "named": [] if o.claim is None else [{"effect": e, "target": t} for e, t in o.claim.named],
        "right": o.match.right, "strict": o.match.strict, "target_right": o.match.target_right,
        "highest_wrong_probability": o.surest_wrong, "trouble": o.trouble,
    }  # fmt: skip


def summarise(method: str, outcomes: Sequence[Outcome]) -> Summary:
    """The figures of ``outcomes``. A case without a comparison counts as wrong."""
    changed = [o for o in outcomes if o.answer.effects]
    single = [o for o in changed if len(o.answer.effects) == 1]
    known = [o for o in outcomes if not lacking(o.answer)]
    wrong = [o for o in outcomes if not o.match.right]
    sizes = [size for o in outcomes for size in o.sizes]
    planted = [
        (p.effect, dose, named)
        for o in changed
        for p, dose, named in zip(o.answer.effects, o.answer.notes["dose"], o.match.named, strict=True)
    ]
    seconds = [o.seconds for o in outcomes if o.seconds is not None]
    return Summary(
        method=method,
        outcomes=tuple(outcomes),
        right=rate(o.match.right for o in outcomes),
        strict=rate(o.match.strict for o in outcomes),
        target_right=rate(o.match.target_right for o in known),
        right_on_changed=rate(o.match.right for o in changed),
        same_on_none=rate(o.match.right for o in outcomes if not o.answer.effects),
        same_on_changed=rate(o.claim is not None and o.claim.verdict == "same" for o in changed),
        lacking=rate(o.match.right for o in outcomes if lacking(o.answer)),
        size_error=median(s.relative_error for s in sizes) if sizes else None,
        interval_coverage=rate(s.covered for s in sizes),
        surest_wrong=max((p for o in outcomes if (p := o.surest_wrong) is not None), default=None),
        sure_and_wrong=rate(o.sure_and_wrong for o in wrong),
        by_source=_grouped(outcomes, lambda o: o.source),
        by_number=_grouped(outcomes, lambda o: str(len(o.answer.effects)) if o.answer.effects else NONE),
        by_kind=_rates((effect, named) for effect, _, named in planted),
        by_dose=_rates((str(dose), named) for _, dose, named in planted),
        by_visible=_rates(
            (VISIBLE[seen], named)
            for o in changed
            for seen, named in zip(o.visible, o.match.named, strict=True)
            if seen is not None
        ),
        right_by_kind=_grouped(single, lambda o: o.answer.effects[0].effect),
        right_by_dose=_grouped(single, lambda o: str(o.answer.notes["dose"][0])),
        seconds=median(seconds) if seconds else None,
        failed=sum(o.claim is None for o in outcomes),
    )


def _grouped(outcomes: Iterable[Outcome], key: Callable[[Outcome], str]) -> dict[str, Rate]:
    return _rates((key(o), o.match.right) for o in outcomes)


def _rates(pairs: Iterable[tuple[str, bool]]) -> dict[str, Rate]:
    found: dict[str, list[bool]] = {}
    for name, hit in pairs:
        found.setdefault(name, []).append(hit)
    return {name: rate(found[name]) for name in sorted(found)}
