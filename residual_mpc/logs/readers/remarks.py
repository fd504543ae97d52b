"""Findings about columns that are absent or unknown, and those of all runs alike gathered into one."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from residual_mpc.logs.columns import GROUPS
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.readers.layout import Layout
from residual_mpc.logs.run import Run


def remarks_on_columns(run: Run, layout: Layout, left_out: Collection[str], topics: Mapping[str, str]) -> list[Finding]:
    """Columns that [log] names and the run's table lacks, and those of the table that have no meaning here; of a
    recording (topics: column -> topic) the topics that were not read."""
    remarks = []
    for name, column in layout.absent.items():
        message = f"[log] refers to column {column!r}, which this table does not have"
        remarks.append(Finding("warning", "absent column", run.name, name, None, message))
    unread = dict.fromkeys(topics[name] for name in left_out if name in topics)
    unread = dict.fromkeys(t for t in unread if all(n in left_out for n, topic in topics.items() if topic == t))
    for topic in unread:
        message = f"topic {topic} is not used"
        remarks.append(Finding("info", "unused topic", run.name, "", None, message))
    for name in run.extra:
        if topics.get(name) in unread:
            continue
        if name in left_out:
            message = f"unknown column {name!r} was dropped to save memory"
        else:
            message = f"unknown column {name!r} is kept but not compared"
        remarks.append(Finding("info", "unknown column", run.name, name, None, message, _near(name)))
    return remarks


def _near(name: str) -> str:
    """A remedy where an unknown column looks like a slip of the pen (`postion.j1`)."""
    head, dot, tail = name.partition(".")
    near = difflib.get_close_matches(head.lower(), [*GROUPS, "t"], n=1, cutoff=0.8)
    return f"did you mean {near[0] + dot + tail!r}?" if near and near[0] != head else ""


def gathered(findings: Sequence[Finding], runs: int) -> Iterator[Finding]:
    """What was found in every run alike is said once, without a run's name."""
    alike: dict[Finding, int] = {}
    for finding in findings:
        general = replace(finding, run="")
        alike[general] = alike.get(general, 0) + 1
    said = set()
    for finding in findings:
        general = replace(finding, run="")
        if runs == 1 or alike[general] < runs:
            yield finding
        elif general not in said:
            said.add(general)
            yield general
