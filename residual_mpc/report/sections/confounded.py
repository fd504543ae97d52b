"""Effects whose predictions on these runs cannot be told apart."""

from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.groups import Member, effects_of, member_names


def confounded(document: Document, evidence: Evidence) -> Section | None:
    """There where groups were found."""
    groups = document.get("confounded") or []
    if not groups:
        return None
    chosen = {(effect["effect"], effect.get("target")) for effect in document["explanation"]}
    shown = [[(words, _is_chosen(m, chosen)) for words, m in zip(member_names(g), g, strict=True)] for g in groups]
    # An experiment is for the groups all of whose parts it names.
    experiment = document.get("next_experiment") or {}
    parts = set(experiment.get("parts") or [])
    parted = [len(parts & _names(group)) >= 2 for group in groups]
    body = render("sections/confounded.html.jinja", groups=list(zip(shown, parted, strict=True)),
                  what=experiment.get("what"))  # fmt: skip
    return Section("confounded", "Effects that cannot be told apart", body)


def _is_chosen(member: Member, chosen: set[tuple[str, str | None]]) -> bool:
    return {(effect["effect"], effect.get("target")) for effect in effects_of(member)} <= chosen


def _names(group: list[Member]) -> set[str]:
    return {effect["effect"] for member in group for effect in effects_of(member)}
