"""The result of testing the diagnosis on new runs."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.confirmation import (
    OUTCOMES,
    changed_words,
    confirmation_sentence,
    explanation_name,
    explanation_status,
    size_words,
)
from residual_mpc.report.words.effects import name_at


def confirmation(document: Document, evidence: Evidence) -> Section | None:
    """There if the diagnosis was tested on new runs."""
    made = document.get("confirmation")
    if not made:
        return None
    body = render(
        "sections/confirmation.html.jinja",
        sentence=confirmation_sentence(made),
        runs=made["runs"],
        changed=[changed_words(c) for c in made["changed"]],
        effects=[(name_at(e), e, OUTCOMES[e["outcome"]], size_words(e)) for e in made["effects"]],
        explanations=[(explanation_name(e), e, explanation_status(e)) for e in made["explanations"]],
        gaps=made["gaps"],
        largest=max((g[k] or 0.0 for g in made["gaps"] for k in ("nominal", "explained")), default=0.0) or 1.0,
    )
    return Section("confirmation", "Test on new runs", body)
