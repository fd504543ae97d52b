"""The scores of recorded runs as text and as one page that needs no network."""

from __future__ import annotations

from pathlib import Path

from residual_mpc.blind.recorded.score.match import lacking
from residual_mpc.blind.recorded.score.outcome import Outcome
from residual_mpc.blind.recorded.score.score import RecordedScores
from residual_mpc.blind.recorded.score.summary import Summary
from residual_mpc.blind.records import Answer
from residual_mpc.blind.score.page import number, percent
from residual_mpc.files import write_atomically


def write_recorded_page(scores: RecordedScores, path: Path) -> None:
    """Write the HTML page to ``path``."""
    from jinja2 import Environment, PackageLoader

    environment = Environment(
        loader=PackageLoader("residual_mpc.blind"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    first = scores.summaries[0]
    page = environment.get_template("recorded.html").render(
        scores=scores, first=first, cases=sum(len(s.cases) for s in scores.suites),
        sections=sections(scores), percent=percent, wrong=[_wrong(o) for o in first.outcomes if not o.match.right],
    )  # fmt: skip
    write_atomically(path, page)


def lines(scores: RecordedScores) -> list[str]:
    """The tables as text, one line a figure."""
    names = [s.method for s in scores.summaries]
    out = ["methods: " + ", ".join(names)] if len(names) > 1 else []
    for title, rows in sections(scores):
        out += [title] + [f"  {name:<58} " + "   ".join(cells) for name, cells in rows]
    return out


def sections(scores: RecordedScores) -> list[tuple[str, list[tuple[str, list[str]]]]]:
    """(title, rows) of every table; a row has one cell a method."""
    every = scores.summaries
    total = [
        ("right: the set of effects, up to groups", [percent(s.right) for s in every]),
        ("strict: the set of effects as named, verdict changed", [percent(s.strict) for s in every]),
        ("target right, among right answers", [percent(s.target_right) for s in every]),
        ("right, where something was changed", [percent(s.right_on_changed) for s in every]),
        ("same, where nothing was changed", [percent(s.same_on_none) for s in every]),
        ("same, where something was changed", [percent(s.same_on_changed) for s in every]),
        ("partial or unknown, where the library lacks the effect", [percent(s.lacking) for s in every]),
        ("median relative error of the size", [number(s.size_error) for s in every]),
        ("true size inside the 95 % interval", [percent(s.interval_coverage) for s in every]),
        ("highest probability of a wrong effect", [number(s.surest_wrong) for s in every]),
        ("wrong answers that were stated at 0.9 or more", [percent(s.sure_and_wrong) for s in every]),
        ("median seconds per case", [number(s.seconds) for s in every]),
        ("cases without a comparison", [str(s.failed) for s in every]),
    ]
    return [
        ("All cases", total),
        ("Right, by source", _rows(every, "by_source")),
        ("Right, by number of changes", _rows(every, "by_number")),
        ("Planted changes that are named, by kind", _rows(every, "by_kind")),
        ("Planted changes that are named, by dose (1: barely visible, 5: large)", _rows(every, "by_dose")),
        ("Planted changes that are named, by the smallest size said to show", _rows(every, "by_visible")),
        ("Right among cases with one change, by kind", _rows(every, "right_by_kind")),
        ("Right among cases with one change, by dose", _rows(every, "right_by_dose")),
    ]


def _rows(every: tuple[Summary, ...], name: str) -> list[tuple[str, list[str]]]:
    tables = [getattr(s, name) for s in every]
    keys = sorted({key for table in tables for key in table})
    return [(key, [percent(t[key]) if key in t else "\N{EN DASH}" for t in tables]) for key in keys]


def _wrong(o: Outcome) -> dict[str, object]:
    """A wrong case in words."""
    changed = [
        f"{_place(p.effect, p.target)} {', '.join(f'{k} {v:.3g}' for k, v in p.parameters.items())} (dose {dose}{z})"
        for p, dose, z in zip(o.answer.effects, o.answer.notes["dose"], _visibilities(o.answer), strict=True)
    ]
    said = o.trouble or (o.claim.verdict if o.claim else "")
    named = [] if o.claim is None else [_place(*n) + _probability(o, n) for n in o.claim.named]
    return {
        "case": o.name, "source": o.source, "changed": changed or ["nothing"], "said": said, "named": named,
        "lacking": lacking(o.answer),
    }  # fmt: skip


def _visibilities(answer: Answer) -> list[str]:
    """Of each change, in words; empty where a change has none, or an older suite does not state it."""
    stated = answer.notes.get("visibility", [None] * len(answer.effects))
    return ["" if z is None else f", z {z:.1f}" for z in stated]


def _place(effect: str, target: str | None) -> str:
    return effect if target is None else f"{effect} ({target})"


def _probability(o: Outcome, name: tuple[str, str | None]) -> str:
    p = None if o.claim is None else o.claim.probabilities.get(name)
    return "" if p is None else f" {p:.2f}"
