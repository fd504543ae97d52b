"""The verdict in one sentence, with the figures that carry it."""

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.section import Document, Section, render
from residual_mpc.report.words.verdict import TITLES, headline, unseen


def verdict(document: Document, evidence: Evidence) -> Section:
    """Always there: it opens the report."""
    body = render(
        "sections/verdict.html.jinja",
        verdict=document["verdict"],
        title=TITLES[document["verdict"]],
        headline=headline(document),
        gap=document["gap"],
        shrink=document.get("shrink"),
        unseen=unseen(document["held_out"]),
        confounded=document.get("confounded") or [],
    )
    return Section("verdict", "Verdict", body)
