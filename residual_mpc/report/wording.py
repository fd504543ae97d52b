"""The whole diagnosis in one sentence that anyone understands."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.effects import name, sentence_of
from residual_mpc.report.words.numbers import listed, number, percent

NAMED = 3  # causes named in the sentence; the rest are counted
WORTH_SAYING = 0.05  # a learned residual that closes less than this is not worth the sentence

# Effects of which one says "adding that delay" rather than "modelling that".
ADDED = ("delay", "lag", "friction", "payload", "bias", "armature", "slope")


def sentence(document: Mapping[str, Any]) -> str:
    """The verdict of diagnosis.json in one sentence. Raises KeyError for a verdict that there is not."""
    say = {"no_gap": _no_gap, "effects": _effects, "partial": _partial, "unknown": _unknown}
    return say[document["verdict"]](document)


def unseen(held_out: Sequence[Any]) -> str:
    """What was kept back: whole runs, or stretches of runs."""
    whole = all(isinstance(part, str) for part in held_out)
    return "runs no fit has seen" if whole else "stretches no fit has seen"


def _no_gap(document: Mapping[str, Any]) -> str:
    return "The model predicts this robot as well as the sensors can tell: there is no gap to explain."


def _effects(document: Mapping[str, Any]) -> str:
    return f"{_causes(document)}; {_adding(document)} removes {_achieved(document)}."


def _partial(document: Mapping[str, Any]) -> str:
    explained = f"{_causes(document)}; {_adding(document)} removes {_achieved(document)}"
    return f"{explained}, and no known effect explains the rest."


def _unknown(document: Mapping[str, Any]) -> str:
    gap = document["gap"]
    size = f"In {number(gap['horizon'], 2)} s the model misses {percent(gap['before'])} of the motion"
    learned = (document.get("unexplained") or {}).get("learned_residual_shrink") or 0.0
    hope = f", though a learned residual closes {percent(learned)} of it" if learned >= WORTH_SAYING else ""
    return f"{size}, more than sensor noise can do, and no known effect explains it{hope}."


def _causes(document: Mapping[str, Any]) -> str:
    effects = document["explanation"]
    said = effects if len(effects) <= NAMED + 1 else effects[:NAMED]  # "1 more" is no shorter than the effect
    sentences = [sentence_of(effect) for effect in said]
    if len(effects) > len(said):
        sentences.append(f"{len(effects) - len(said)} more effects add to it")
    text = listed(sentences)
    return text[:1].upper() + text[1:]


def _adding(document: Mapping[str, Any]) -> str:
    effects = document["explanation"]
    if len(effects) > 1:
        return "adding these to the model"
    last = name(effects[0]).split()[-1]
    return f"adding that {last}" if last in ADDED else "modelling that"


def _achieved(document: Mapping[str, Any]) -> str:
    return f"{percent(document['shrink']['value'])} of the gap on {unseen(document['held_out'])}"
