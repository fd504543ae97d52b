"""What the audit found in the logs before anything was fitted."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render

ORDER = {"error": 0, "warning": 1, "info": 2}
SHOWN = 12  # findings in the table; the rest fold away


def audit(document: Document, evidence: Evidence) -> Section | None:
    """There where the document holds an audit, even an empty one."""
    if document.get("audit") is None:
        return None
    findings = sorted(document["audit"], key=lambda finding: ORDER.get(finding["severity"], len(ORDER)))
    body = render("sections/audit.html.jinja", shown=findings[:SHOWN], folded=findings[SHOWN:])
    return Section("audit", "Log audit", body)
