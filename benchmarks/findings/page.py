"""The page: a table of what is true, what 0.1.0 said and what is said now."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.findings.run import Outcome
from benchmarks.findings.score import plants, score

WORDS = """\
An answer is right when it names the true set of effects,
up to reported groups that hold the true one. It is doubted when it is not right but says so (`partial` or
`unknown`) and gives no wrong effect, nor a true one of a wrong size, a probability of 0.5 or more. `highest wrong` is
the largest probability of an effect that is not there, `extra` the number of these.
"""
HEAD = "| case | finding | true | said by 0.1.0 | said now | mark | highest wrong | extra | seconds |"


def page(outcomes: Sequence[Outcome], version: str, absent: Sequence[str]) -> str:
    """The page in Markdown."""
    rows = [row(o) for o in outcomes]
    marks = Counter((o.case.finding, mark_of(o)) for o in outcomes)
    return "\n".join(
        [
            "# Cases of outside checks\n",
            f"Diagnosed by {version}, with `python -m benchmarks.findings`. {WORDS}",
            *(f"{line}\n" for line in absent),
            "| finding | cases | right | doubted | wrong | not diagnosed |",
            "| --- | --- | --- | --- | --- | --- |",
            *(summary(finding, marks) for finding in sorted({o.case.finding for o in outcomes})),
            "",
            HEAD,
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def mark_of(o: Outcome) -> str:
    """right, doubted or wrong; none where there is nothing to mark."""
    return "none" if o.document is None or o.truth is None else score(o.document, o.truth, o.closed).mark


def summary(finding: int, marks: Mapping[tuple[int, str], int]) -> str:
    """The counts of one finding."""
    counts = [marks.get((finding, mark), 0) for mark in ("right", "doubted", "wrong", "none")]
    return f"| {finding} | {sum(counts)} | {' | '.join(map(str, counts))} |"


def row(o: Outcome) -> str:
    """One line of the table."""
    if o.document is None or o.truth is None:
        true = "" if o.truth is None else true_line(o.truth)
        said = "" if o.truth is None else said_before(o.truth)
        why = f"not diagnosed: {cell(o.trouble)}"
        return f"| {o.case.name} | {o.case.finding} | {true} | {said} | {why} | | | | {o.seconds:.0f} |"
    s = score(o.document, o.truth, o.closed)
    now = said_line(o.document)
    if o.closed is not None:
        now += f"; closes {o.closed:.0%} of the gap on motions not seen"
    mark = s.mark + (f" ({s.why})" if s.why and s.mark != "right" else "")
    mark += ", targets wrong" if s.targets is False else ""
    figures = f"{mark} | {f'{s.highest_wrong:.2f}' if s.extras else ''} | {s.extras} | {o.seconds:.0f}"
    return f"| {o.case.name} | {o.case.finding} | {true_line(o.truth)} | {said_before(o.truth)} | {now} | {figures} |"


def cell(text: str) -> str:
    """Text that fits a table's cell."""
    return text.replace("|", "/").replace("\n", " ")


def true_line(truth: Mapping[str, Any]) -> str:
    """What was planted."""
    parts = []
    for effect, entry in truth["planted"].items():
        for one in plants(entry):
            numbers = ", ".join(f"{v:.3g}" for k, v in one.items() if k != "target" and isinstance(v, int | float))
            parts.append(f"`{effect}` {numbers}" + (f" on {one['target']}" if one.get("target") else ""))
    if truth.get("closes") is not None:
        return f"known to nobody; {truth['closes']:.0%} closed is right"
    return "; ".join(parts) or "no gap"


def said_before(truth: Mapping[str, Any]) -> str:
    """What 0.1.0 said: its document where the truth holds it, else the words."""
    kept = truth.get("said_by_0.1.0")
    return said_line(kept) if kept else cell(str(truth.get("said", "")))


def said_line(document: Mapping[str, Any]) -> str:
    """The verdict and the named effects with their values and probabilities."""
    parts = [named(cause) for cause in document["explanation"]]
    return f"`{document['verdict']}`" + (f": {'; '.join(parts)}" if parts else "")


def named(cause: Mapping[str, Any]) -> str:
    """One effect; a parameter is {"value": ...} in diagnosis.json and [value, interval] in a shared truth.json."""
    values = [p["value"] if isinstance(p, dict) else p[0] for p in cause["parameters"].values()]
    numbers = ", ".join(f"{v:.3g}" for v in values if isinstance(v, int | float))
    target = f" on {cause['target']}" if cause["target"] else ""
    return f"{cause['effect']} {numbers}{target} ({cause['probability']:.2f})"
