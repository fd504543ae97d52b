"""The next experiment: the motion or the sensor that would settle what is open."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render


def next_experiment(document: Document, evidence: Evidence) -> Section | None:
    """There where the diagnosis proposes one."""
    experiment = document.get("next_experiment")
    if not experiment:
        return None
    commands = experiment.get("commands")
    body = render(
        "sections/next.html.jinja",
        what=experiment["what"],
        parts=[str(part).replace("_", " ") for part in experiment.get("parts") or []],
        commands=commands if isinstance(commands, str) else None,
        sensors=[s for s in experiment.get("sensors") or [] if s not in experiment["what"]],  # said once
        excite=experiment.get("excite"),
    )
    return Section("next", "Next experiment", body)
