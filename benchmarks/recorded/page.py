"""The page in Markdown: a table of all rows, and a section for each."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version
from statistics import fmean
from typing import Any

from benchmarks.recorded.measure import Measured, commit
from benchmarks.recorded.rows import PICTURED, SOURCES
from benchmarks.recorded.words import beside, cause_line, chain_line, group_line, held_out, inside, named_of


def document(rows: list[Measured]) -> str:
    """The page."""
    today = datetime.now(UTC).date().isoformat()
    parts = [
        "# Recorded robots\n",
        *in_short([m.document["shrink"] for m in rows if m.document is not None and m.document.get("shrink")]),
        f"Measured on {today} with residual-mpc {version('residual-mpc')}{commit()} by\n"
        "`python -m benchmarks.recorded --page FILE`. The recordings are not part of this "
        "repository.\n",
        "What each diagnosis was not told, what it expected and what was achieved: [real data,\n"
        "withheld](withheld.md).\n",
        "Gaps and shrinks are measured on runs, or stretches of runs, that no fit has seen. The expected shrink was\n"
        "stated before they were evaluated. A gap of 0.10 means that within one second the model misses a tenth of\n"
        "the motion. Brackets contain 95 % intervals.\n",
        "| robot | gap before | after | noise floor | shrink expected | achieved | verdict | named |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *(table_line(m) for m in rows),
        "",
        *each_once("run of the XL330", [m for m in rows if m.row.name.startswith("xl330, fourth")]),
        *each_once("motion of the SO-101", [m for m in rows if m.row.name.startswith("so101, fourth")]),
        *(details(m) for m in rows),
        "## Sources\n",
        SOURCES,
    ]
    return "\n".join(parts)


def in_short(shrinks: list[dict[str, Any]]) -> list[str]:
    """The page in two sentences; nothing where no shrink was measured."""
    if not shrinks:
        return []
    values = [s["value"] for s in shrinks]
    held = sum(inside(s["value"], s["expected_ci95"]) for s in shrinks)
    return [
        f"On recorded robots the named effects remove {min(values):.0%} to {max(values):.0%} of the gap on runs that\n"
        f"no fit has seen. In {held} of {len(shrinks)} diagnoses the achieved shrink lies inside the interval that\n"
        "was expected.\n"
    ]


def each_once(what: str, fourths: list[Measured]) -> list[str]:
    """What was expected and came in the mean of the four, where all four were measured. what: of which each is held out
    once."""
    shrinks = [m.document["shrink"] for m in fourths if m.document is not None and m.document["shrink"]]
    if len(shrinks) < 4:
        return []
    expected, achieved = ([s[name] for s in shrinks] for name in ("expected", "value"))
    return [
        f"In the four fourths each {what} is held out once. Their mean expected shrink is\n"
        f"{fmean(expected):.1%} and their mean achieved shrink {fmean(achieved):.1%}; in a single one the two differ "
        f"by up to {max(abs(e - a) for e, a in zip(expected, achieved, strict=True)):.0%}.\n"
    ]


def table_line(m: Measured) -> str:
    """One row of the table."""
    d = m.document
    if d is None:
        return f"| {m.row.name} | not measured: {m.trouble} | | | | | | |"
    if m.row.command == "gap":
        return f"| {m.row.name} | {d['nominal']:.3f} | | {d['noise_floor']:.2g} | | | not diagnosed here | |"
    gap, shrink = d["gap"], d["shrink"]
    low, high = shrink["expected_ci95"] if shrink else (0, 0)
    expected = f"{shrink['expected']:.0%} ({low:.0%} to {high:.0%})" if shrink else ""
    low, high = shrink["ci95"] if shrink else (0, 0)
    achieved = f"{shrink['value']:.0%} ({low:.0%} to {high:.0%})" if shrink else ""
    named = ", ".join(named_of(c) for c in d["explanation"])
    figures = f"{gap['before']:.3f} | {gap['after']:.3f} | {gap['noise_floor']:.2g}"
    return f"| {m.row.name} | {figures} | {expected} | {achieved} | `{d['verdict']}` | {named} |"


def details(m: Measured) -> str:
    """What the table has no room for."""
    lines = [f"## {m.row.name}\n", f"{m.row.what[:1].upper()}{m.row.what[1:]}. {m.row.known}\n"]
    if m.shown:
        lines.append(f"```\n{m.shown}\n```\n")
    d = m.document
    if d is None:
        lines.append(f"Not measured: {m.trouble}.\n")
    elif m.row.command == "gap":
        worst = sorted(d["channels"].items(), key=lambda item: -item[1]["nominal"])
        channels = ", ".join(f"`{name}` {c['nominal']:.2f}" for name, c in worst)
        lines.append(f"{d['windows']} windows of {d['horizon']:g} s. By channel: {channels}.\n")
    else:
        lines.append(f"{d['verdict_sentence']}\n")
        lines += [f"- {cause_line(c)}{beside(c, m.row)}" for c in d["explanation"]]
        if len(d["explanation"]) > 1:
            lines.append(f"- gap as effects are added, over all windows: {chain_line(d['stages_of_gap'])}")
            if m.row.name == PICTURED:
                lines.append(f"\n![The gap of the SO-101 after each effect is added](images/{PICTURED}-staged.png)\n")
        lines += [f"- cannot be told apart on these runs: {group_line(g)}" for g in d["confounded"]]
        if d["shrink"] and not inside(d["shrink"]["value"], d["shrink"]["expected_ci95"]):
            lines.append("- the achieved shrink lies outside the expected interval")
        rest = d["unexplained"]
        share, learned = rest["share"], rest["learned_residual_shrink"]
        lines.append(
            f"- unexplained: {share:.0%} of the squared gap beyond the floor; "
            f"a learned residual removes {learned:.0%} of the remaining gap"
        )
        lines.append(f"- {d['gap']['windows']} windows held out: {held_out(d['held_out'])}")
        lines.append(f"- {m.seconds:.0f} s\n")
    return "\n".join(lines)
