"""What the robot did and what the model predicts, on held-out data."""

from residual_mpc.report.evidence.clock import first_stamp, since_start
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.figures import traces as figures
from residual_mpc.report.sections.section import Document, Section, render


def traces(document: Document, evidence: Evidence) -> Section | None:
    """There where the evidence holds signals."""
    if not evidence.panels:
        return None
    panels = [
        {
            "panel": panel,
            "from": since_start(evidence, panel.run, panel.t[0]),
            "to": since_start(evidence, panel.run, panel.t[-1]),
            "svg": figures.traces(panel, f"trace{index}", first_stamp(evidence, panel.run)),
            "before": figures.rms_error(panel, panel.before),
            "after": figures.rms_error(panel, panel.after),
        }
        for index, panel in enumerate(evidence.panels)
    ]
    body = render("sections/traces.html.jinja", panels=panels, horizon=document["gap"]["horizon"],
                  explained=bool(document["explanation"]))  # fmt: skip
    return Section("traces", "Measured and predicted motion", body)
