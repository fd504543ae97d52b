"""The scores as one page that needs no network, and as text."""

from __future__ import annotations

from pathlib import Path

from residual_mpc.blind.score import explained, plots, tables
from residual_mpc.blind.score.calibration import calibration_error
from residual_mpc.blind.score.confusion import confusion
from residual_mpc.blind.score.score import Scores
from residual_mpc.blind.score.summary import Summary
from residual_mpc.blind.score.tables import number, percent
from residual_mpc.files import write_atomically


def write_page(scores: Scores, path: Path) -> None:
    """Write the HTML page to ``path``."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("residual_mpc.blind"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    first = scores.summaries[0]
    write_atomically(
        path,
        environment.get_template("page.html").render(
            scores=scores,
            first=first,
            table=figures(scores),
            tables=_tables(scores),
            levels=plots.levels_plot(scores.summaries),
            reliability=plots.reliability_plot(first),
            shrink=plots.shrink_plot(first),
            settled=settled(scores),
            wrong=tables.answers([o for o in first.outcomes if not o.match.right]),
            inexact=tables.answers([o for o in first.outcomes if o.match.right and not o.strict.exact]),
            explained=explained.table(scores.explained) if scores.explained else None,
            faults=[(n, kind, explained.MEANING[kind]) for kind, n in explained.faults(scores.explained).items()],
            confusion=plots.confusion_plot(confusion(first.outcomes)),
            percent=percent,
            strict=first.strict.every,
        ),
    )


def figures(scores: Scores) -> list[tuple[str, list[str]]]:
    """The table of methods: (name of the figure, one cell a method)."""
    rows: list[tuple[str, list[str]]] = []

    def row(name: str, cells: list[str]) -> None:
        rows.append((name, cells))

    every = scores.summaries
    row("right", [percent(s.right) for s in every])
    for level in every[0].by_level:
        row(f"right, {level.replace('_', ' ')}", [percent(s.by_level[level]) for s in every])
    for family in every[0].by_family:
        row(f"right, {family}", [percent(s.by_family[family]) for s in every])
    row("target right, among right answers", [percent(s.target_right) for s in every])
    row("false alarms on cases without a gap", [percent(s.false_alarms) for s in every])
    row("unknown or partial if the library lacks the cause", [percent(s.unknown_said) for s in every])
    row("unknown if the library has the cause", [percent(s.unknown_wrongly) for s in every])
    row("true value inside the 95 % interval", [percent(s.interval_coverage) for s in every])
    row("median parameter error", [number(s.parameter_error) for s in every])
    row("achieved shrink inside the expected interval", [percent(s.shrink_coverage) for s in every])
    row("mean difference of achieved and expected shrink", [number(s.shrink_error) for s in every])
    row("calibration error of the probabilities", [number(calibration_error(s.bins)) for s in every])
    row("mean group size in right answers", [number(s.group_size) for s in every])
    row("confounded cases with a group that holds the cause", [percent(s.group_reported) for s in every])
    row("median seconds per case", [number(s.seconds) for s in every])
    row("cases without a diagnosis", [str(_failed(s)) for s in every])
    return rows


def settled(scores: Scores) -> list[tuple[str, str]]:
    """What the experiments settled: (name of the figure, cell); nothing where none were carried out."""
    e = scores.experiments
    if e is None:
        return []
    rows = [
        ("groups resolved by the experiment", e.groups),
        ("of these, groups with the cause among them", e.groups_holding),
    ]
    rows += [(f"groups resolved, {name.replace('_', ' ')}", r) for name, r in e.by_effects.items()]
    rows += [
        ("groups not resolved", e.stayed),
        ("groups whose second answer is wrong", e.became_wrong),
        ("groups whose experiment failed", e.failed),
        ("close alternatives resolved", e.rivals),
        ("of these, pairs with the cause among them", e.rivals_holding),
        ("right before the experiment", e.right_before),
        ("right after the experiment", e.right_after),
        ("right after without exchanging group members", e.named_after),
        ("right before if the library lacks the cause", e.lacking_before),
        ("right after if the library lacks the cause", e.lacking_after),
    ]
    return [(name, percent(r)) for name, r in rows if r.count]


def text(scores: Scores) -> list[str]:
    """Everything on the page that needs no picture, for a terminal."""
    found = [f"{figure:<52} " + "   ".join(cells) for figure, cells in figures(scores)]
    found += [f"{figure:<52} {cell}" for figure, cell in settled(scores)]
    for title, table in _tables(scores):
        found += ["", title, *table.lines()]
    return [*found, "", "planted: named", *confusion(scores.summaries[0].outcomes).lines()]


def _tables(scores: Scores) -> list[tuple[str, tables.Table]]:
    first = scores.summaries[0].method
    return [
        (f"{first}: lenient and strict", tables.lenient_and_strict(scores.summaries[0])),
        ("by level and family", tables.by_level(scores.summaries)),
        ("gaps on held-out runs, medians", tables.gaps(scores.summaries)),
    ]


def _failed(summary: Summary) -> int:
    return sum(o.claim is None for o in summary.outcomes)
