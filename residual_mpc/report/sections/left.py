"""The remaining error: the unexplained share, what a learned residual removes of it, and constants that moved."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.figures.curve import curve
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.rest import OWN_STEP, component_name, form_of, hint_of, regime_words, resemblance

LEARNERS = {"ridge": "a ridge regression", "network": "a neural network"}
LIFT = 1.2  # from which a regime is listed


def left(document: Document, evidence: Evidence) -> Section | None:
    """There unless there is no gap and nothing moved."""
    moved = document.get("moved") or []
    if document["verdict"] == "no_gap" and not moved:
        return None
    unexplained, learned = document.get("unexplained") or {}, document.get("learned") or {}
    shrink = unexplained.get("learned_residual_shrink")
    body = render(
        "sections/left.html.jinja",
        verdict=document["verdict"],
        share=unexplained.get("share"),
        learned=shrink,
        by=LEARNERS.get(str(learned.get("by")), ""),
        asked=bool(learned.get("asked", True)),
        outliers=document.get("outliers"),
        moved=moved,
        rest=_rest(document.get("remainder")),
    )
    return Section("left", "Remaining error", body)


def _rest(remainder: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """What the template says of the remainder; None where there is none worth describing."""
    if not remainder:
        return None
    return {
        "components": [{**c, "name": component_name(c["name"])} for c in remainder["components"]],
        "regimes": [
            {**r, "words": regime_words(r["name"])}
            for r in remainder["regimes"]
            if r["share"] >= 0.05 and r["lift"] >= LIFT
        ],
        "half_within": remainder["half_within"],
        "depends": [
            {
                **d,
                "form": form_of(d),
                "hint": hint_of(d),
                "svg": curve(d, component_name(d["curve"]["component"]), f"rest{k}")
                if len(d["curve"]["x"]) > 1
                else "",
            }
            for k, d in enumerate(remainder["depends_on"])
        ],
        "own_step": bool(remainder.get("own_step")),
        "like": OWN_STEP if remainder.get("own_step") else resemblance(remainder["resembles"]),
    }
