"""The strict figures of many cases, of all of them and by level and family."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from residual_mpc.blind.levels import LEVELS
from residual_mpc.blind.score.calibration import Bin, calibration_error, reliability
from residual_mpc.blind.score.outcome import Outcome
from residual_mpc.blind.score.rates import Rate, rate
from residual_mpc.blind.score.strict import LIKELY, SURE, stated_as_sure, statements, surest_wrong
from residual_mpc.blind.score.usefulness import Usefulness, usefulness


@dataclass(frozen=True)
class WrongEffect:
    """An effect that the robot does not have, and the probability that it was given."""

    case: str
    level: str
    effect: str
    target: str | None
    probability: float


@dataclass(frozen=True)
class StrictFigures:
    """Rates over cases, unless they say otherwise."""

    exact: Rate
    exact_targets: Rate  # among the exact sets
    planted_named: Rate  # over planted effects: the explanation itself names it
    planted_in_group: Rate  # over planted effects: at least a group that stands for it does
    extra_effects: int  # named effects that are not planted, over all cases
    extra_in_background: int  # of these, the ones that the background has
    wrong_effects: int  # of these, the ones that the robot does not have
    with_extra: Rate  # cases that name one or more
    wrong_in_partial: Rate  # over the verdicts `partial`: a wrong effect is named
    drawn_coverage: Rate  # over parameters: the interval holds the drawn value, which nothing moves
    best_fit_coverage: Rate  # over parameters: the interval holds the best fit, which is moved towards the estimate
    bins: tuple[Bin, ...]  # of all candidates
    named_bins: tuple[Bin, ...]  # of the named effects alone
    surest_wrong: WrongEffect | None
    wrong_and_sure: Rate  # over the wrong answers: a wrong effect is stated at SURE or more
    sure_and_there: Rate  # over named effects at SURE or more: the robot has it, or a group stands for one that it has
    sure_and_planted: Rate  # over the same: it is planted itself
    doubt_where_lacking: Rate  # over cases whose cause the library lacks: no wrong effect is stated above LIKELY
    gap: Usefulness

    def document(self) -> dict[str, Any]:
        """As plain JSON values."""
        worst = self.surest_wrong
        return {
            "exact": self.exact.document(),
            "exact_targets": self.exact_targets.document(),
            "planted_named": self.planted_named.document(),
            "planted_named_or_in_group": self.planted_in_group.document(),
            "extra_effects": self.extra_effects,
            "extra_effects_in_background": self.extra_in_background,
            "wrong_effects": self.wrong_effects,
            "cases_with_extra_effects": self.with_extra.document(),
            "wrong_in_partial": self.wrong_in_partial.document(),
            "drawn_coverage": self.drawn_coverage.document(),
            "best_fit_coverage": self.best_fit_coverage.document(),
            "calibration_error": calibration_error(self.bins),
            "calibration_error_named": calibration_error(self.named_bins),
            "highest_wrong_probability": None if worst is None else worst.probability,
            "highest_wrong": None if worst is None else {
                "case": worst.case, "level": worst.level, "effect": worst.effect, "target": worst.target},
            "wrong_and_sure": self.wrong_and_sure.document(),
            "sure_and_there": self.sure_and_there.document(),
            "sure_and_planted": self.sure_and_planted.document(),
            "doubt_where_lacking": self.doubt_where_lacking.document(),
            "gap": self.gap.document(),
        }  # fmt: skip


@dataclass(frozen=True)
class StrictSummary:
    """The strict figures of one method."""

    every: StrictFigures
    by_level: dict[str, StrictFigures]
    by_family: dict[str, StrictFigures]

    def document(self) -> dict[str, Any]:
        """The `strict` object of a score."""
        return {
            **self.every.document(),
            "by_level": {name: f.document() for name, f in self.by_level.items()},
            "by_family": {name: f.document() for name, f in self.by_family.items()},
        }


def strict_summary(outcomes: Sequence[Outcome]) -> StrictSummary:
    """The strict figures of ``outcomes``."""
    families = sorted({o.answer.family for o in outcomes})
    return StrictSummary(
        every=strict_figures(outcomes),
        by_level={
            name: strict_figures(found) for name in LEVELS if (found := [o for o in outcomes if o.answer.level == name])
        },
        by_family={name: strict_figures([o for o in outcomes if o.answer.family == name]) for name in families},
    )


def strict_figures(outcomes: Sequence[Outcome]) -> StrictFigures:
    """The strict figures of ``outcomes``, taken together."""
    found = [how for o in outcomes for _, how in o.strict.planted]
    parameters = [p for o in outcomes for p in o.parameters]
    partial = [o for o in outcomes if o.claim is not None and o.claim.verdict == "partial"]
    claims = [(o, o.claim) for o in outcomes if o.claim is not None]
    stated = [(p, true) for o, claim in claims for _, p, true in statements(o.answer, claim)]
    named = [(p, true) for o, claim in claims for n, p, true in statements(o.answer, claim) if n in claim.named]
    sure = [found for o, claim in claims for found in stated_as_sure(o.answer, claim)]
    lacking = [o for o, _ in claims if o.answer.unknown or o.answer.withheld]
    return StrictFigures(
        exact=rate(o.strict.exact for o in outcomes),
        exact_targets=rate(o.strict.exact_targets for o in outcomes),
        planted_named=rate(how == "named" for how in found),
        planted_in_group=rate(how != "missed" for how in found),
        extra_effects=sum(len(o.strict.extra) for o in outcomes),
        extra_in_background=sum(len(o.strict.extra) - len(o.strict.wrong) for o in outcomes),
        wrong_effects=sum(len(o.strict.wrong) for o in outcomes),
        with_extra=rate(bool(o.strict.extra) for o in outcomes),
        wrong_in_partial=rate(bool(o.strict.wrong) for o in partial),
        drawn_coverage=rate(p.covers_drawn for p in parameters),
        best_fit_coverage=rate(p.covered for p in parameters),
        bins=reliability([p for p, _ in stated], [true for _, true in stated]),
        named_bins=reliability([p for p, _ in named], [true for _, true in named]),
        surest_wrong=_surest_wrong(outcomes),
        wrong_and_sure=rate((o.strict.stated or 0.0) >= SURE for o, _ in claims if not o.match.right),
        sure_and_there=rate(there for there, _ in sure),
        sure_and_planted=rate(planted for _, planted in sure),
        doubt_where_lacking=rate((o.strict.stated or 0.0) <= LIKELY for o in lacking),
        gap=usefulness([claim for _, claim in claims]),
    )


def _surest_wrong(outcomes: Sequence[Outcome]) -> WrongEffect | None:
    found = [
        WrongEffect(o.name, o.answer.level, *worst[0], worst[1])
        for o in outcomes
        if o.claim is not None and (worst := surest_wrong(o.answer, o.claim)) is not None
    ]
    return max(found, key=lambda w: w.probability, default=None)
