"""What each figure of the report means."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render


def definitions(document: Document, evidence: Evidence) -> Section:
    """Always there: it closes the report."""
    body = render(
        "sections/definitions.html.jinja",
        horizon=document["gap"]["horizon"],
        schema=document.get("schema"),
        command=document.get("command"),
        seconds=document.get("seconds"),
    )
    return Section("definitions", "Definitions", body)
