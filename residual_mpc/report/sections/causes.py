"""What causes the gap: the named set with its parameters, its rivals, and all candidates by probability."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.section import Document, Section, render
from residual_mpc.report.words.groups import member_name

SHOWN = 10  # candidates in the table; the rest fold away
RIVALS = 6  # rival sets listed; the document holds them all


def causes(document: Document, evidence: Evidence) -> Section | None:
    """There where a cause is named or was considered."""
    candidates = sorted(document.get("candidates") or [], key=_rank)
    if not document["explanation"] and not candidates:
        return None
    rivals = sorted(document.get("rivals") or [], key=lambda rival: -rival["probability"])
    body = render(
        "sections/causes.html.jinja",
        verdict=document["verdict"],
        explanation=document["explanation"],
        shown=candidates[:SHOWN],
        folded=candidates[SHOWN:],
        named={(effect["effect"], effect.get("target")) for effect in document["explanation"]},
        rivals=[(member_name(rival["terms"]), rival["probability"]) for rival in rivals[:RIVALS]],
    )
    return Section("causes", "What causes it", body)


def _rank(candidate: Mapping[str, Any]) -> tuple[float, float]:
    return -candidate["probability"], -(candidate.get("shrink") or 0.0)
