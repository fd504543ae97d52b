"""The causes: the named set with its parameters, the alternatives to it, and all candidates by probability."""

from collections.abc import Mapping
from functools import partial
from typing import Any

from residual_mpc.effects.surroundings import TORQUE_RIPPLE
from residual_mpc.report.evidence.clock import since_start
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.figures.curve import law_curve, ripple_curve
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.effects import remarks
from residual_mpc.report.words.groups import member_name
from residual_mpc.report.words.servo import motor_lines
from residual_mpc.report.words.summary import SURE
from residual_mpc.report.words.uncertain import by_certainty, uncertain_line

SHOWN = 10  # candidates in the table; the rest fold away
RIVALS = 6  # alternatives listed; the document holds them all


def causes(document: Document, evidence: Evidence) -> Section | None:
    """There where a cause is named or was considered."""
    candidates = sorted(document.get("candidates") or [], key=_rank)
    if not document["explanation"] and not candidates:
        return None
    since = partial(since_start, evidence)
    shown, uncertain = by_certainty(document)
    rivals = sorted(document.get("rivals") or [], key=lambda rival: -rival["probability"])
    body = render(
        "sections/causes.html.jinja",
        verdict=document["verdict"],
        count=len(document["explanation"]),
        explanation=[
            (effect, [*motor_lines(effect), *remarks(effect, since)], _picture(effect, f"law{k}"))
            for k, effect in enumerate([*shown, *uncertain])
        ],
        certain=len(shown),
        uncertain=uncertain_line(uncertain) if uncertain else "",
        sure=SURE,
        shown=candidates[:SHOWN],
        folded=candidates[SHOWN:],
        named={(effect["effect"], effect.get("target")) for effect in document["explanation"]},
        rivals=[(member_name(rival["terms"]), rival["probability"]) for rival in rivals[:RIVALS]],
    )
    return Section("causes", "Causes", body)


def _picture(effect: Mapping[str, Any], name: str) -> str:
    """Of a law or a ripple; empty for what has none. name: unique on the page."""
    if "knots" in effect:
        return law_curve(effect, name)
    wave = {p.name for p in TORQUE_RIPPLE.parameters if not p.optional} <= set(effect.get("parameters") or {})
    return ripple_curve(effect, name) if effect["effect"] == TORQUE_RIPPLE.name and wave else ""


def _rank(candidate: Mapping[str, Any]) -> tuple[float, float]:
    return -candidate["probability"], -(candidate.get("shrink") or 0.0)
