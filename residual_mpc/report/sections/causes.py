"""What causes the gap: the named set with its parameters, and the candidates in the order of their probability."""

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.section import Document, Section, render

SHOWN = 10  # candidates in the table; the rest fold away


def causes(document: Document, evidence: Evidence) -> Section | None:
    """There where a cause is named or was considered."""
    ranked = sorted(document.get("candidates") or [], key=lambda c: (-c["probability"], -(c.get("shrink") or 0.0)))
    if not document["explanation"] and not ranked:
        return None
    named = {(effect["effect"], effect.get("target")) for effect in document["explanation"]}
    body = render(
        "sections/causes.html.jinja",
        verdict=document["verdict"],
        explanation=document["explanation"],
        shown=ranked[:SHOWN],
        folded=ranked[SHOWN:],
        named=named,
    )
    return Section("causes", "What causes it", body)
