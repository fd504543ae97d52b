"""The causes: the named set with its parameters, the alternatives to it, and all candidates by probability."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from residual_mpc.report.evidence.clock import since_start
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.figures.curve import law_curve
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.effects import remarks
from residual_mpc.report.words.groups import member_name
from residual_mpc.report.words.summary import SURE, surest_first

SHOWN = 10  # candidates in the table; the rest fold away
RIVALS = 6  # alternatives listed; the document holds them all


def causes(document: Document, evidence: Evidence) -> Section | None:
    """There where a cause is named or was considered."""
    candidates = sorted(document.get("candidates") or [], key=_rank)
    if not document["explanation"] and not candidates:
        return None
    since = partial(since_start, evidence)
    rivals = sorted(document.get("rivals") or [], key=lambda rival: -rival["probability"])
    body = render(
        "sections/causes.html.jinja",
        verdict=document["verdict"],
        explanation=[
            (effect, remarks(effect, since), law_curve(effect, f"law{k}") if "knots" in effect else "")
            for k, effect in enumerate(surest_first(document["explanation"]))
        ],
        sure=SURE,
        shown=candidates[:SHOWN],
        folded=candidates[SHOWN:],
        named={(effect["effect"], effect.get("target")) for effect in document["explanation"]},
        rivals=[(member_name(rival["terms"]), rival["probability"]) for rival in rivals[:RIVALS]],
    )
    return Section("causes", "Causes", body)


def _rank(candidate: Mapping[str, Any]) -> tuple[float, float]:
    return -candidate["probability"], -(candidate.get("shrink") or 0.0)
