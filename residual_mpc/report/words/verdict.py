"""The verdict in one sentence, and the sentence that hedges it."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.report.words.effects import name, sentence
from residual_mpc.report.words.numbers import listed, number, percent

NAMED = 3  # causes named in the headline; the rest are counted
WORTH_SAYING = 0.05  # a learned residual that closes less than this is not worth the headline

TITLES = {
    "no_gap": "No gap",
    "effects": "Explained",
    "partial": "Partly explained",
    "unknown": "Cause unknown",
}


def headline(document: Mapping[str, Any]) -> str:
    """The whole diagnosis in one sentence. Raises KeyError for a verdict that the contract does not know."""
    return {"no_gap": _no_gap, "effects": _effects, "partial": _partial, "unknown": _unknown}[document["verdict"]](
        document
    )


def unseen(held_out: Sequence[Any]) -> str:
    """What was kept back: whole runs, or stretches of runs."""
    return "runs no fit has seen" if all(isinstance(part, str) for part in held_out) else (
        "stretches no fit has seen")  # fmt: skip


def _no_gap(document: Mapping[str, Any]) -> str:
    return "The model predicts this robot as well as the sensors can tell: there is no gap to explain."


def _effects(document: Mapping[str, Any]) -> str:
    return f"{_causes(document)}; {_adding(document)} removes {_achieved(document)}."


def _partial(document: Mapping[str, Any]) -> str:
    return (
        f"{_causes(document)}; {_adding(document)} removes {_achieved(document)},"
        " and the rest has a cause that is not among the known effects."
    )


def _unknown(document: Mapping[str, Any]) -> str:
    gap = document["gap"]
    size = f"In {number(gap['horizon'], 2)} s the model misses {percent(gap['before'])} of the motion"
    learned = (document.get("unexplained") or {}).get("learned_residual_shrink") or 0.0
    hope = f", though a learned residual closes {percent(learned)} of it" if learned >= WORTH_SAYING else ""
    return f"{size}, far beyond the sensor noise, and no known effect explains it{hope}."


def _causes(document: Mapping[str, Any]) -> str:
    effects = document["explanation"]
    sentences = [sentence(effect) for effect in effects[:NAMED]]
    if len(effects) > NAMED:
        more = len(effects) - NAMED
        sentences.append(f"{more} more {'effect acts' if more == 1 else 'effects act'} on it")
    text = listed(sentences)
    return text[:1].upper() + text[1:]


def _adding(document: Mapping[str, Any]) -> str:
    effects = document["explanation"]
    if len(effects) > 1:
        return "adding these to the model"
    return f"adding that {name(effects[0]).split()[-1]}" if effects[0]["effect"].endswith(
        ("_delay", "_lag", "_friction", "payload", "_bias")) else "modelling that"  # fmt: skip


def _achieved(document: Mapping[str, Any]) -> str:
    return f"{percent(document['shrink']['value'])} of the gap on {unseen(document['held_out'])}"
