"""What runs that no fit has seen, made to test the diagnosis, say about it."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.confirmation import (
    OUTCOMES,
    changed_words,
    confirmation_sentence,
    explanation_name,
    size_words,
)
from residual_mpc.report.words.effects import name_at

BADGES = {"agrees": "effects", "other size": "partial", "denies": "unknown", "open": "no_gap"}


def confirmation(document: Document, evidence: Evidence) -> Section | None:
    """There where new runs were given to confirm the diagnosis."""
    made = document.get("confirmation")
    if not made:
        return None
    body = render(
        "sections/confirmation.html.jinja",
        sentence=confirmation_sentence(made),
        runs=made["runs"],
        changed=[changed_words(c) for c in made["changed"]],
        effects=[(name_at(e), e, OUTCOMES[e["outcome"]], BADGES[e["outcome"]], size_words(e)) for e in made["effects"]],
        explanations=[(explanation_name(e), e) for e in made["explanations"]],
        gaps=made["gaps"],
        largest=max((g[k] for g in made["gaps"] for k in ("nominal", "explained")), default=0.0) or 1.0,
    )
    return Section("confirmation", "What the new runs say", body)
