"""A comparison of two sets of runs, as lines for a terminal and as a page."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.page import Frame, page
from residual_mpc.report.sections.audit import audit
from residual_mpc.report.sections.section import Section, render
from residual_mpc.report.words.changes import (
    alike_sentence,
    capital,
    change_clause,
    change_line,
    comparison_sentence,
    errors_differ,
    gap_is_explained,
    is_ratio,
    number_words,
    stretch_words,
    visible_words,
    warnings,
)
from residual_mpc.report.words.groups import member_name, member_names
from residual_mpc.report.words.numbers import listed, number, percent, plain
from residual_mpc.report.words.servo import motor_lines

__all__ = ["comparison_lines", "comparison_page", "comparison_sentence"]

Document = Mapping[str, Any]  # comparison.json

TITLES = {"same": "No change found", "changed": "Changed", "partial": "Partly explained", "unknown": "Unknown"}
BADGES = {"same": "no_gap", "changed": "effects", "partial": "partial", "unknown": "unknown"}
MENTIONED = 6  # of the smallest changes that the runs would show, in the terminal
LIKELY = 0.005  # probability from which another candidate is listed


def comparison_lines(document: Document) -> list[str]:
    """The verdict, then a line for each figure, change and doubt."""
    gap, changes = document["gap"], document["changes"]
    with_changes = f" -> {number(gap['after_explained'])} with the {_noun(changes)}, fitted to both" if changes else ""
    details = [
        f"gap at {number(gap['horizon'])} s of the model fitted to the runs before: {number(gap['before'])} on these "
        f"runs, {number(gap['after'])} on the runs after{with_changes} (noise floor {number(gap['noise_floor'], 2)})",
        *warnings(document),
        *(line for change in changes for line in (change_line(change), *(f"  {line}" for line in motor_lines(change)))),
        *(alike_sentence(group) for group in document["confounded"]),
    ]
    if document["account"]:
        details.append(f"model errors common to both sets: {_account(document)}")
    visible = [visible_words(v) for v in document.get("visible", ()) if v["target"] is None]
    if document["verdict"] == "same" and visible:
        details.append(f"smallest changes that these runs would show: {', '.join(visible[:MENTIONED])}")
    details.append(f"observations: {stretch_words(document)} (a stretch is a run or a part of one)")
    details += list(document["notes"])
    if document["next_experiment"]:
        details.append(f"next experiment: {document['next_experiment']['what']}")
    headline = document.get("verdict_sentence") or comparison_sentence(document)
    return [plain(headline), *(f"  {plain(line)}" for line in details)]


def comparison_page(document: Document) -> str:
    """The page as text: it needs no network, no script and no second file."""
    sections = [
        _verdict(document), _changes(document), _gap(document), _groups(document), _visible(document),
        _unseen(document), audit(document, Evidence()), _definitions(document),
    ]  # fmt: skip
    frame = Frame(document["robot"], "what changed", "What changed between two sets of runs", "comparison.json")
    return page(frame, sections)


def _verdict(document: Document) -> Section:
    headline = document.get("verdict_sentence") or comparison_sentence(document)
    body = render(
        "comparison/verdict.html.jinja",
        badge=BADGES[document["verdict"]],
        title=TITLES[document["verdict"]],
        headline=headline,
        verdict=document["verdict"],
        gap=document["gap"],
        changes=_noun(document["changes"]) if document["changes"] else "",
        stretches=capital(stretch_words(document)),
        warnings=warnings(document),
        notes=document["notes"],
        visible=bool(document.get("visible")),
    )
    return Section("verdict", "Verdict", body)


def _changes(document: Document) -> Section | None:
    """There where something changed: each change with its numbers and intervals, and the other candidates."""
    if not document["changes"]:
        return None
    cards = [
        (change_clause(c), c, [(k, number_words(c, k), interval_of(c, k)) for k in c["parameters"]])
        for c in document["changes"]
    ]
    named = {(c["effect"], c["target"]) for c in document["changes"]}
    likely = [c for c in document["candidates"] if c["probability"] > LIKELY]
    others = [c for c in likely if (c["effect"], c["target"]) not in named]
    body = render("comparison/changes.html.jinja", cards=cards, others=others, motor=motor_lines)
    return Section("changes", "What changed", body)


def interval_of(change: Mapping[str, Any], parameter: str) -> dict[str, Any] | None:
    """Where "no change", the change and its interval lie on an axis, in per cent of its length; None where there is no
    interval or nothing before."""
    n = change["parameters"][parameter]
    size = n["change"]
    low, high = size["ci95"]
    if n["before"] is None or low is None or high is None or size["value"] is None:
        return None
    none = 1.0 if is_ratio(change, parameter) else 0.0
    ends = (min(none, low, size["value"]), max(none, high, size["value"]))
    margin = 0.08 * (ends[1] - ends[0]) or 1.0
    start, length = ends[0] - margin, ends[1] - ends[0] + 2.0 * margin
    place = {"none": none, "low": low, "high": high, "value": size["value"]}
    return {k: 100.0 * (v - start) / length for k, v in place.items()}


def _gap(document: Document) -> Section:
    gap, changes = document["gap"], document["changes"]
    rows = [
        (name, number(c["before"]), number(c["after"]), number(c["after_explained"]), number(c["noise_floor"]))
        for name, c in gap["channels"].items()
    ]
    bars = [("after", "runs before", gap["before"]), ("before", "runs after", gap["after"])]
    if changes:
        bars.append(("after", f"runs after, with the {_noun(changes)} in the model", gap["after_explained"]))
    bars.append(("floor", "noise floor", gap["noise_floor"]))
    bars = [b for b in bars if b[2] is not None]
    body = render(
        "comparison/gap.html.jinja", rows=rows, gap=gap, bars=bars,
        largest=max((b[2] for b in bars), default=0.0) or 1.0,
        changes=_noun(changes) if changes else "", account=_account(document), left=_left(document),
        finer=document["verdict"] == "partial" and gap_is_explained(document) and errors_differ(document),
        p=document["unexplained"].get("p"),
    )  # fmt: skip
    return Section("gap", "The gap before and after", body)


def _left(document: Document) -> str:
    """What the changes leave of the rise; empty where there was none to explain."""
    gap = document["gap"]
    known = gap["before"] is not None and gap["after"] is not None
    if not document["changes"] or not known or gap["after"] <= gap["before"]:
        return ""
    return percent(document["unexplained"]["share"])


def _groups(document: Document) -> Section | None:
    if not document["confounded"]:
        return None
    following = document["next_experiment"] or {}
    groups = [member_names(group) for group in document["confounded"]]
    body = render("comparison/groups.html.jinja", groups=groups, what=following.get("what"))
    return Section("confounded", "Changes that cannot be told apart", body)


def _visible(document: Document) -> Section | None:
    """How large a change has to be to be found: what a verdict of no change leaves open."""
    if not document.get("visible"):
        return None
    rows = [(v, visible_words(v)) for v in document["visible"]]
    body = render(
        "comparison/visible.html.jinja",
        rows=rows,
        stretches=stretch_words(document),
        shown=document["verdict"] == "same",
    )
    return Section("visible", "The smallest changes that these runs would show", body)


def _unseen(document: Document) -> Section | None:
    if not document["not_testable"]:
        return None
    reasons: dict[str, list[Document]] = {}
    for effect in document["not_testable"]:
        reasons.setdefault(effect["why"], []).append(effect)
    body = render("sections/not_testable.html.jinja", reasons=reasons)
    return Section("not-testable", "Changes that these runs cannot show", body)


def _definitions(document: Document) -> Section:
    body = render(
        "comparison/definitions.html.jinja",
        horizon=document["gap"]["horizon"],
        runs=document.get("runs") or {},
        schema=document.get("schema"),
        command=document.get("command"),
    )
    return Section("definitions", "Definitions", body)


def _account(document: Document) -> str:
    return listed([member_name(t) for t in document["account"]]) if document["account"] else ""


def _noun(changes: list[Any]) -> str:
    return "change" if len(changes) == 1 else "changes"
