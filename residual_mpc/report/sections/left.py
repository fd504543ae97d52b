"""What is left: the unexplained share, what a flexible learner finds in it, and constants that moved."""

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.section import Document, Section, render


def left(document: Document, evidence: Evidence) -> Section | None:
    """There unless there is no gap and nothing moved."""
    moved = document.get("moved") or []
    if document["verdict"] == "no_gap" and not moved:
        return None
    body = render(
        "sections/left.html.jinja",
        verdict=document["verdict"],
        gap=document["gap"],
        share=document["unexplained"]["share"],
        learned=document["unexplained"].get("learned_residual_shrink"),
        moved=moved,
        explained=bool(document["explanation"]),
    )
    return Section("left", "What is left", body)
