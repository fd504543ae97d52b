"""What the owner of the servos can change about the effects that are named."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.numbers import listed
from residual_mpc.report.words.servo import noun_of


def servo_changes(document: Document, evidence: Evidence) -> Section | None:
    """There where a setting of a servo concerns a named effect."""
    changes = document.get("servo_changes") or []
    if not changes:
        return None
    servos = document.get("servos") or []
    rows = [
        {**change, "of": "" if len(change["actuators"]) == len(servos) else listed(change["actuators"])}
        for change in changes
    ]
    noun = noun_of(document)
    body = render("sections/servo_changes.html.jinja", changes=rows, noun=noun)
    return Section("servo-changes", f"What you can change on the {noun}", body)
