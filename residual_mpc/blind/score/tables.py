"""The strict figures beside the lenient ones, as tables for the page and for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from residual_mpc.blind.score.calibration import calibration_error
from residual_mpc.blind.score.claim import Name
from residual_mpc.blind.score.outcome import Outcome
from residual_mpc.blind.score.rates import Rate, rate
from residual_mpc.blind.score.strict import LIKELY, SURE
from residual_mpc.blind.score.strict_figures import StrictFigures
from residual_mpc.blind.score.summary import Summary


@dataclass(frozen=True)
class Table:
    """Cells by row; the first column names the rows."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def lines(self) -> list[str]:
        """Aligned, for a terminal."""
        every = [self.columns, *self.rows]
        widths = [max(len(row[k]) for row in every) for k in range(len(self.columns))]
        return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in every]


def lenient_and_strict(summary: Summary) -> Table:
    """The same questions by both rules."""
    s = summary.strict.every
    lacking = [o for o in summary.outcomes if o.answer.unknown or o.answer.withheld]
    rows = (
        ("answer", f"right: {percent(summary.right)}", f"exact set: {percent(s.exact)}"),
        ("target", f"among the right: {percent(summary.target_right)}", f"among the exact: {percent(s.exact_targets)}"),
        (
            "planted effects",
            f"named, or in a group that counts: {percent(s.planted_in_group)}",
            f"named: {percent(s.planted_named)}",
        ),
        (
            "effects named besides",
            f"that the robot does not have: {s.wrong_effects}",
            f"that are not planted: {s.extra_effects}, {s.extra_in_background} of them in the background; "
            f"in {short(s.with_extra)} cases",
        ),
        (
            "library lacks the cause",
            f"unknown or partial: {percent(summary.unknown_said)}",
            f"and no wrong effect named: {percent(rate(o.strict.exact for o in lacking))}",
        ),
        ("wrong effect in a partial", "not counted", percent(s.wrong_in_partial)),
        (
            "true value inside the 95 % interval",
            f"best fit, clipped: {percent(summary.interval_coverage)}",
            f"drawn value: {percent(s.drawn_coverage)}",
        ),
        (
            "calibration error",
            f"candidates outside the background: {number(calibration_error(summary.bins))}",
            f"all candidates: {number(calibration_error(s.bins))}; "
            f"named effects: {number(calibration_error(s.named_bins))}",
        ),
        ("highest probability of a wrong effect", "not counted", _surest(s)),
        (
            f"wrong answers with a wrong effect at {SURE:g} or more",
            "not counted",
            percent(s.wrong_and_sure),
        ),
        (
            f"named effects at {SURE:g} or more",
            f"the robot has it, or a group with it: {percent(s.sure_and_there)}",
            f"planted: {percent(s.sure_and_planted)}",
        ),
        (
            f"library lacks the cause: no wrong effect above {LIKELY:g}",
            "not counted",
            percent(s.doubt_where_lacking),
        ),
    )
    return Table(("figure", "lenient", "strict"), rows)


def by_level(summaries: Sequence[Summary]) -> Table:
    """One row a level and a family: the first method's figures, and the other methods' right and exact answers."""
    first, *others = summaries
    columns = (
        "", "cases", "right", "exact set", "planted: found", "named", "extra (background)", "wrong in partial",
        "interval: best fit", "drawn", "calibration, named", *(f"{s.method}: right, exact" for s in others),
    )  # fmt: skip
    rows = []
    for name, strict, lenient, other in _parts(summaries):
        rows.append(
            (
                name, str(lenient.count), share(lenient), share(strict.exact), share(strict.planted_in_group),
                share(strict.planted_named), f"{strict.extra_effects} ({strict.extra_in_background})",
                short(strict.wrong_in_partial), share(strict.best_fit_coverage), share(strict.drawn_coverage),
                number(calibration_error(strict.named_bins)), *(f"{share(r)}, {share(s.exact)}" for s, r in other),
            )
        )  # fmt: skip
    return Table(columns, tuple(rows))


def gaps(summaries: Sequence[Summary]) -> Table:
    """One row a level and a family: the median gaps, with a forecast of constant velocity as the least use."""
    others = summaries[1:]
    columns = (
        "", "nominal model", "diagnosed model", *(f"{s.method}: model" for s in others), "noise floor",
        "constant velocity", "diagnosed beats it", *(f"{s.method}: beats it" for s in others),
    )  # fmt: skip
    rows = []
    for name, strict, _, other in _parts(summaries):
        g = strict.gap
        rows.append(
            (
                name, number(g.before), number(g.after), *(number(s.gap.after) for s, _ in other),
                number(g.noise_floor), number(g.constant_velocity), short(g.useful),
                *(short(s.gap.useful) for s, _ in other),
            )
        )  # fmt: skip
    return Table(columns, tuple(rows))


def answers(outcomes: Sequence[Outcome]) -> Table:
    """One row a case: what was planted, and what was said."""
    rows = []
    for o in outcomes:
        a, c = o.answer, o.claim
        planted = names([(p.effect, p.target) for p in a.effects]) or ", ".join(a.unknown) or "nothing"
        extra = ", ".join(e if e in o.strict.wrong else f"{e} (background)" for e in o.strict.extra)
        rows.append(
            (
                o.name, f"{a.family}, {a.level}, {a.seed}", planted + (", withheld" if a.withheld else ""),
                c.verdict if c else o.trouble, names(c.named) if c else "", extra,
            )
        )  # fmt: skip
    return Table(("case", "family, level, seed", "planted", "verdict", "named", "not planted"), tuple(rows))


def names(effects: Sequence[Name]) -> str:
    """Effects with their targets in brackets."""
    return ", ".join(effect if target is None else f"{effect} ({target})" for effect, target in effects)


Part = tuple[str, StrictFigures, Rate, list[tuple[StrictFigures, Rate]]]


def _parts(summaries: Sequence[Summary]) -> list[Part]:
    """(name, the first method's strict figures and lenient rate, those of the others), from all cases to a family."""
    first, *others = summaries
    parts: list[Part] = [("all", first.strict.every, first.right, [(s.strict.every, s.right) for s in others])]
    for level, strict in first.strict.by_level.items():
        more = [(s.strict.by_level[level], s.by_level[level]) for s in others]
        parts.append((level.replace("_", " "), strict, first.by_level[level], more))
    for family, strict in first.strict.by_family.items():
        more = [(s.strict.by_family[family], s.by_family[family]) for s in others]
        parts.append((f"family {family}", strict, first.by_family[family], more))
    return parts


def _surest(s: StrictFigures) -> str:
    w = s.surest_wrong
    if w is None:
        return "–"
    return f"{w.probability:.2f}, {w.effect}{f' ({w.target})' if w.target else ''} in {w.case}, {w.level}"


def percent(rate: Rate) -> str:
    """A rate with its interval and count."""
    if rate.value is None or rate.ci95 is None:
        return "–"
    low, high = rate.ci95
    return f"{100 * rate.value:.0f} % ({100 * low:.0f} to {100 * high:.0f}), {rate.hits} of {rate.count}"


def short(rate: Rate) -> str:
    """A rate as a count."""
    return f"{rate.hits} of {rate.count}" if rate.count else "–"


def share(rate: Rate) -> str:
    """A rate alone."""
    return "–" if rate.value is None else f"{100 * rate.value:.0f} %"


def number(value: float | None) -> str:
    """Three significant figures."""
    return "–" if value is None else f"{value:.3g}"
