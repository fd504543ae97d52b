"""A comparison of two sets of runs, as lines for a terminal and as a page."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.sections.section import Section, render
from residual_mpc.report.words.changes import (
    change_clause,
    change_line,
    comparison_sentence,
    number_words,
    stretch_words,
)
from residual_mpc.report.words.groups import group_sentence, member_name
from residual_mpc.report.words.numbers import number, percent, plain

__all__ = ["comparison_lines", "comparison_page", "comparison_sentence"]

Document = Mapping[str, Any]  # comparison.json

TITLES = {"same": "Same", "changed": "Changed", "partial": "Partly explained", "unknown": "Unknown"}
BADGES = {"same": "no_gap", "changed": "effects", "partial": "partial", "unknown": "unknown"}


def comparison_lines(document: Document) -> list[str]:
    """The verdict, then a line for each figure, change and doubt."""
    gap = document["gap"]
    explained = f" -> {number(gap['after_explained'])} with the changes" if document["changes"] else ""
    details = [
        f"gap of the model fitted to the runs before: {number(gap['before'])} on them, {number(gap['after'])} on those "
        f"after{explained}; noise floor {number(gap['noise_floor'], 2)} ({stretch_words(document)})",
        *(change_line(change) for change in document["changes"]),
        *(group_sentence(group) for group in document["confounded"]),
    ]
    if document["account"]:
        details.append(f"common to both sets: {', '.join(member_name(t) for t in document['account'])}")
    if document["next_experiment"]:
        details.append(f"next experiment: {document['next_experiment']['what']}")
    headline = document.get("verdict_sentence") or comparison_sentence(document)
    return [plain(headline), *(f"  {plain(line)}" for line in details)]


def comparison_page(document: Document) -> str:
    """The page as text: it needs no network, no script and no second file."""
    sections = [_verdict(document), _changes(document), _gap(document), _groups(document), _unseen(document)]
    there = [s for s in sections if s is not None]
    return str(render("comparison.html.jinja", robot=document["robot"], sections=there)) + "\n"


def _verdict(document: Document) -> Section:
    body = render(
        "comparison/verdict.html.jinja",
        badge=BADGES[document["verdict"]],
        title=TITLES[document["verdict"]],
        headline=document.get("verdict_sentence") or comparison_sentence(document),
        gap=document["gap"],
        explained=bool(document["changes"]),
        stretches=stretch_words(document),
        notes=document["notes"],
    )
    return Section("verdict", "Verdict", body)


def _changes(document: Document) -> Section | None:
    """There where something changed: each change with its numbers, and the candidates."""
    if not document["changes"]:
        return None
    cards = [
        (change_clause(change), change, {k: number_words(n) for k, n in change["parameters"].items()})
        for change in document["changes"]
    ]
    named = {(c["effect"], c["target"]) for c in document["changes"]}
    others = [c for c in document["candidates"] if (c["effect"], c["target"]) not in named and c["probability"] > 0.005]
    body = render("comparison/changes.html.jinja", cards=cards, others=others)
    return Section("changes", "What changed", body)


def _gap(document: Document) -> Section:
    channels = document["gap"]["channels"]
    rows = [
        (name, number(c["before"]), number(c["after"]), number(c["after_explained"]), number(c["noise_floor"]))
        for name, c in channels.items()
    ]
    body = render(
        "comparison/gap.html.jinja", rows=rows, gap=document["gap"], explained=bool(document["changes"]),
        account=[member_name(t) for t in document["account"]], left=percent(document["unexplained"]["share"]),
    )  # fmt: skip
    return Section("gap", "The gap before and after", body)


def _groups(document: Document) -> Section | None:
    if not document["confounded"]:
        return None
    following = document["next_experiment"] or {}
    groups = [[member_name(m) for m in group] for group in document["confounded"]]
    body = render("comparison/groups.html.jinja", groups=groups, what=following.get("what"))
    return Section("confounded", "Changes that cannot be told apart", body)


def _unseen(document: Document) -> Section | None:
    if not document["not_testable"]:
        return None
    reasons: dict[str, list[Document]] = {}
    for effect in document["not_testable"]:
        reasons.setdefault(effect["why"], []).append(effect)
    body = render("sections/not_testable.html.jinja", reasons=reasons)
    return Section("not-testable", "Changes that these runs cannot show", body)
