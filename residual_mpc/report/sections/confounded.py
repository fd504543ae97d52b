"""Causes whose predictions on these runs cannot be told apart."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.evidence import Evidence
from residual_mpc.report.section import Document, Section, render
from residual_mpc.report.words.effects import name

Member = Mapping[str, Any] | list[Mapping[str, Any]]  # one effect, or several that do together what another does


def confounded(document: Document, evidence: Evidence) -> Section | None:
    """There where groups were found."""
    groups = document.get("confounded") or []
    if not groups:
        return None
    chosen = {(effect["effect"], effect.get("target")) for effect in document["explanation"]}
    shown = [[(_words(member), _is_chosen(member, chosen)) for member in group] for group in groups]
    # An experiment is for the groups all of whose parts it names.
    experiment = document.get("next_experiment") or {}
    parts = set(experiment.get("parts") or [])
    parted = [len(parts & _names(group)) >= 2 for group in groups]
    body = render("sections/confounded.html.jinja", groups=list(zip(shown, parted, strict=True)),
                  what=experiment.get("what"))  # fmt: skip
    return Section("confounded", "What cannot be told apart", body)


def _effects(member: Member) -> list[Mapping[str, Any]]:
    return member if isinstance(member, list) else [member]


def _words(member: Member) -> str:
    return " with ".join(
        name(effect) + (f" ({effect['target']})" if effect.get("target") else "") for effect in _effects(member)
    )


def _is_chosen(member: Member, chosen: set[tuple[str, str | None]]) -> bool:
    return {(effect["effect"], effect.get("target")) for effect in _effects(member)} <= chosen


def _names(group: list[Member]) -> set[str]:
    return {effect["effect"] for member in group for effect in _effects(member)}
