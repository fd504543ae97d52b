"""All cases of one method, as figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from residual_mpc.blind.levels import LEVELS
from residual_mpc.blind.score.calibration import Bin, calibration_error, reliability
from residual_mpc.blind.score.outcome import Outcome
from residual_mpc.blind.score.rates import Rate, rate
from residual_mpc.blind.score.strict_figures import StrictSummary, strict_summary

_LACKING = ("unknown", "partial")


@dataclass(frozen=True)
class Summary:
    """Every figure of one method on one suite."""

    method: str
    outcomes: tuple[Outcome, ...]
    right: Rate
    target_right: Rate  # among the right sets
    by_level: dict[str, Rate]
    by_family: dict[str, Rate]
    by_effect: dict[str, Rate]  # an effect that was planted: how often it was in the explanation, groups used
    false_alarms: Rate  # anything but no_gap on robots without a gap; outliers that are there may be named
    unknown_said: Rate  # where the library lacks the cause
    unknown_wrongly: Rate  # where it does not
    interval_coverage: Rate
    parameter_error: float | None  # median relative error
    shrink_error: float | None  # mean distance of achieved from expected
    shrink_coverage: Rate
    bins: tuple[Bin, ...]
    group_size: float | None  # mean size of the groups that right answers needed
    group_reported: Rate  # where the runs are confounded by design: a group holds the truth
    seconds: float | None  # median a case
    strict: StrictSummary

    def document(self) -> dict[str, Any]:
        """The `score` object of the contract, with more keys."""
        ci = self.right.ci95
        return {
            "method": self.method,
            "cases": self.right.count,
            "right": self.right.value,
            "ci95": None if ci is None else list(ci),
            "by_level": {k: r.value for k, r in self.by_level.items()},
            "false_alarms": self.false_alarms.value,
            "target_right": self.target_right.value,
            "interval_coverage": self.interval_coverage.value,
            "shrink_error": self.shrink_error,
            "calibration_error": calibration_error(self.bins),
            "by_family": {k: r.value for k, r in self.by_family.items()},
            "by_effect": {k: r.value for k, r in self.by_effect.items()},
            "unknown_said": self.unknown_said.value,
            "unknown_wrongly": self.unknown_wrongly.value,
            "parameter_error": self.parameter_error,
            "shrink_coverage": self.shrink_coverage.value,
            "group_size": self.group_size,
            "group_reported": self.group_reported.value,
            "seconds_a_case": self.seconds,
            "strict": self.strict.document(),
            "failed": sum(o.claim is None for o in self.outcomes),
            "rates": {
                "right": self.right.document(),
                "target_right": self.target_right.document(),
                "false_alarms": self.false_alarms.document(),
                "unknown_said": self.unknown_said.document(),
                "unknown_wrongly": self.unknown_wrongly.document(),
                "interval_coverage": self.interval_coverage.document(),
                "shrink_coverage": self.shrink_coverage.document(),
                "by_level": {k: r.document() for k, r in self.by_level.items()},
                "by_family": {k: r.document() for k, r in self.by_family.items()},
                "by_effect": {k: r.document() for k, r in self.by_effect.items()},
            },
            "wrong": [
                {"case": o.name, "level": o.answer.level, "true": _true_names(o), "verdict": _verdict(o),
                 "named": [list(n) for n in o.claim.named] if o.claim else [], "trouble": o.trouble}
                for o in self.outcomes
                if not o.match.right
            ],
        }  # fmt: skip


def summarise(method: str, outcomes: Sequence[Outcome]) -> Summary:
    """The figures of ``outcomes``."""
    every = tuple(outcomes)
    lacking = [o for o in every if o.answer.unknown or o.answer.withheld]
    planted = [o for o in every if o.answer.effects and not o.answer.withheld]
    empty = [o for o in every if not o.answer.effects and not o.answer.unknown]
    parameters = [p for o in every for p in o.parameters]
    stated = [(p, _is_true(o, effect)) for o in every for effect, p in _probabilities(o) if not _is_faint(o, effect)]
    shrinks = [o.claim for o in every if o.claim and o.claim.shrink is not None and o.claim.expected_shrink is not None]
    distances = [
        abs(c.shrink - c.expected_shrink) for c in shrinks if c.shrink is not None and c.expected_shrink is not None
    ]
    times = [o.seconds for o in every if o.seconds is not None]
    sizes = [o.match.group_size for o in planted if o.match.right]
    levels = [name for name in LEVELS if any(o.answer.level == name for o in every)]
    return Summary(
        method=method,
        outcomes=every,
        right=rate(o.match.right for o in every),
        target_right=rate(o.match.target_right for o in every),
        by_level={name: rate(o.match.right for o in every if o.answer.level == name) for name in levels},
        by_family={
            name: rate(o.match.right for o in every if o.answer.family == name)
            for name in sorted({o.answer.family for o in every})
        },
        by_effect=_by_effect(planted),
        false_alarms=rate(not o.match.right for o in empty),
        unknown_said=rate(o.claim is not None and o.claim.verdict in _LACKING for o in lacking),
        unknown_wrongly=rate(o.claim is not None and o.claim.verdict == "unknown" for o in planted),
        interval_coverage=rate(p.covered for p in parameters),
        parameter_error=median(p.relative_error for p in parameters) if parameters else None,
        shrink_error=sum(distances) / len(distances) if distances else None,
        shrink_coverage=rate(
            c.expected_interval[0] <= c.shrink <= c.expected_interval[1]
            for c in shrinks
            if c.expected_interval is not None and c.shrink is not None
        ),
        bins=reliability([p for p, _ in stated], [y for _, y in stated]),
        group_size=sum(sizes) / len(sizes) if sizes else None,
        group_reported=rate(_in_a_group(o) for o in every if o.answer.level == "confounded"),
        seconds=median(times) if times else None,
        strict=strict_summary(every),
    )


def _by_effect(planted: Sequence[Outcome]) -> dict[str, Rate]:
    seen: dict[str, list[bool]] = {}
    for o in planted:
        names = {effect for effect, _ in o.match.reading}
        for p in o.answer.effects:
            seen.setdefault(p.effect, []).append(p.effect in names)
    return {effect: rate(seen[effect]) for effect in sorted(seen)}


def _probabilities(o: Outcome) -> list[tuple[str, float]]:
    """(effect, stated probability), the most probable target of each effect."""
    best: dict[str, float] = {}
    if o.claim is not None:
        for (effect, _), p in o.claim.probabilities.items():
            best[effect] = max(best.get(effect, 0.0), p)
    return list(best.items())


def _is_true(o: Outcome, effect: str) -> bool:
    if o.answer.withheld:
        return False
    return any(p.effect == effect for p in o.answer.effects)


def _in_a_group(o: Outcome) -> bool:
    """Whether a reported group holds the planted effect, as an answer without luck would."""
    wanted = {p.effect for p in o.answer.effects}
    groups = () if o.claim is None else o.claim.groups
    return any(len(g) > 1 and any({e for e, _ in member} == wanted for member in g) for g in groups)


def _is_faint(o: Outcome, effect: str) -> bool:
    """Whether the effect is there so faintly that neither yes nor no would be wrong."""
    return any(p.effect == effect for p in o.answer.background)


def _true_names(o: Outcome) -> list[list[str | None]]:
    return [[p.effect, p.target] for p in o.answer.effects] or [[cause, None] for cause in o.answer.unknown]


def _verdict(o: Outcome) -> str | None:
    return None if o.claim is None else o.claim.verdict
