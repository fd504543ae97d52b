"""Effects of an explanation that are too uncertain to be shown one by one: they are listed in a single line."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.confidence import UNCERTAIN
from residual_mpc.report.words.effects import name_at
from residual_mpc.report.words.groups import Member, effects_of, together
from residual_mpc.report.words.summary import in_sentence, surest_first

Document = Mapping[str, Any]


def by_certainty(document: Document) -> tuple[list[Document], list[Document]]:
    """The effects of the explanation, the surest first: those to show, and those that are too uncertain. An effect that
    the sentence names, or that stands for a group of which one member is likely, is shown."""
    shown: list[Document] = []
    uncertain: list[Document] = []
    said = in_sentence(document["explanation"])
    for effect in surest_first(document["explanation"]):
        probability = effect.get("probability")
        low = probability is not None and probability < UNCERTAIN and not any(effect is other for other in said)
        (uncertain if low and not _stands_for_a_likely_group(effect, document) else shown).append(effect)
    return shown, uncertain


def uncertain_line(uncertain: Sequence[Document]) -> str:
    """ "too uncertain to name, but part of the model: link mass of l2 (probability 0.12), joint compliance of j3
    (0.03)"."""
    first, *more = (f"{effect['probability']:.2f}" for effect in uncertain)
    probabilities = [f"probability {first}", *more]
    parts = [f"{name_at(e)} ({p})" for e, p in zip(uncertain, probabilities, strict=True)]
    return f"too uncertain to name, but part of the model: {', '.join(parts)}"


def told_groups(document: Document, uncertain: Sequence[Document]) -> list[Sequence[Member]]:
    """The groups that cannot be told apart, without those that only uncertain effects stand for."""
    doubted, named = _places(uncertain), _places(document["explanation"])
    groups = document.get("confounded") or []
    return [g for g in groups if not (mine := named & _members(g)) or not mine <= doubted]


def _stands_for_a_likely_group(effect: Document, document: Document) -> bool:
    """Whether it is the only named effect of a group of which one member is likely."""
    place = _places([effect])
    others = _places(document["explanation"]) - place
    groups = [g for g in document.get("confounded") or [] if place <= _members(g) and not others & _members(g)]
    return any(together(group, document) is not None for group in groups)


def _members(group: Sequence[Member]) -> set[tuple[str, str | None]]:
    return _places([effect for member in group for effect in effects_of(member)])


def _places(effects: Sequence[Document]) -> set[tuple[str, str | None]]:
    return {(effect["effect"], effect.get("target")) for effect in effects}
