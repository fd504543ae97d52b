"""Effects that these runs can neither show nor exclude."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render


def not_testable(document: Document, evidence: Evidence) -> Section | None:
    """There where some effect could not be tested."""
    effects = document.get("not_testable") or []
    if not effects:
        return None
    reasons: dict[str, list[Document]] = {}
    for effect in effects:
        reasons.setdefault(effect["why"], []).append(effect)
    return Section("not-testable", "Effects that could not be tested",
                   render("sections/not_testable.html.jinja", reasons=reasons))  # fmt: skip
