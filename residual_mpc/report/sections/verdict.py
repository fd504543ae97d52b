"""The verdict in one sentence, with the figures that carry it."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.gaps import size
from residual_mpc.report.words.groups import group_sentence
from residual_mpc.report.words.rest import rest_sentence
from residual_mpc.report.words.summary import sentence, unseen

TITLES = {
    "no_gap": "No gap",
    "effects": "Explained",
    "partial": "Partly explained",
    "unknown": "Unknown",
}
LONG = 180  # characters, above which the sentence is set smaller


def verdict(document: Document, evidence: Evidence) -> Section:
    """Always there: it opens the report."""
    headline = document.get("verdict_sentence") or sentence(document)
    body = render(
        "sections/verdict.html.jinja",
        verdict=document["verdict"],
        title=TITLES[document["verdict"]],
        headline=headline,
        long=len(headline) > LONG,
        gap=document["gap"],
        missed=size(document["gap"]["before"]),
        shrink=document.get("shrink"),
        unseen=unseen(document["held_out"]),
        rest=rest_sentence(document["remainder"]) if document.get("remainder") else "",
        doubts=[group_sentence(group) for group in document.get("confounded") or []],
        notes=document.get("notes") or [],
    )
    return Section("verdict", "Verdict", body)
