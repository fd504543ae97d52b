"""What is known before a diagnosis is finished, in a sentence each."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.words.effects import name_at, sentence_of
from residual_mpc.report.words.numbers import listed, number, percent, plain


def first_look_sentence(look: Mapping[str, Any]) -> str:
    """The gap, where it lies, and what it resembles: nothing has been fitted yet."""
    gap, floor = number(look["gap"]), number(look["noise_floor"], 2)
    text = f"first look: the gap is about {gap} at {number(look['horizon'], 2)} s (noise floor {floor})"
    if look["channels"]:
        worst = max(look["channels"], key=lambda c: look["channels"][c])
        text += f", largest in {worst} ({percent(look['channels'][worst])})"
    if look["leads"]:
        likeness = [f"{name_at(lead)} ({percent(lead['shrink'])})" for lead in look["leads"]]
        text += f"; it most resembles {listed(likeness)}"
    return plain(text)


def so_far_sentence(answer: Mapping[str, Any]) -> str:
    """The best set of effects so far, and the gap with it on the windows that the search sees."""
    gap, effects = answer["gap"], answer["explanation"]
    before, after, floor = number(gap["before"]), number(gap["after"]), number(gap["noise_floor"], 2)
    causes = listed([sentence_of(e) for e in effects])
    at = f"at {number(gap['horizon'], 2)} s (noise floor {floor})"
    return plain(f"so far: {causes}; gap {before} -> {after} {at}")
