"""What changed between two sets of runs, in words."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.words.effects import name_at
from residual_mpc.report.words.numbers import count, listed, measure, measure_interval, number, percent

Document = Mapping[str, Any]  # comparison.json

SURE = 0.5  # probability from which a change is stated without "possibly"


def comparison_sentence(document: Document) -> str:
    """The verdict in one sentence."""
    stretches = document["stretches"]
    units = f"{stretches['before']} stretches of motion before and {stretches['after']} after"
    verdict = document["verdict"]
    if verdict == "same":
        return f"The two sets differ by no more than runs of one set differ among themselves ({units})."
    if verdict == "unknown":
        return f"The robot has changed, but no effect in the library explains how ({units})."
    said = listed([change_clause(change) for change in document["changes"]])
    headline = f"{said[:1].upper()}{said[1:]}"
    return f"{headline}." if verdict == "changed" else f"{headline}; this is only part of what changed."


def change_clause(change: Mapping[str, Any]) -> str:
    """ "command delay rose by 45 ms", after "possibly" where that is less likely than not."""
    doubt = "possibly " if change["probability"] < SURE else ""
    clauses = [_clause(parameter, n) for parameter, n in change["parameters"].items()]
    return f"{doubt}{_who(change)} {listed(clauses)}"


def change_line(change: Mapping[str, Any]) -> str:
    """A change with its numbers and probability."""
    numbers = [f"{name.replace('_', ' ')} {number_words(n)}" for name, n in change["parameters"].items()]
    return f"{_who(change)}: {'; '.join(numbers)}; probability {percent(change['probability'])}"


def number_words(n: Mapping[str, Any]) -> str:
    """ "+45 ms (26 to 64), from 71 ms to 116 ms"."""
    change = n["change"]
    factor = "times " if _is_ratio(n) else ""
    size = measure_interval(change["value"], change["ci95"], change["unit"])
    unit = "1" if _is_ratio(n) else change["unit"]
    between = ", ".join(f"{word} {measure(n[word], unit)}" for word in ("before", "after") if n[word] is not None)
    note = f" [{n['note']}]" if n.get("note") else ""
    return f"{factor}{size}{f' ({between})' if between else ''}{note}"


def stretch_words(document: Document) -> str:
    """ "15 stretches before, 15 after"."""
    there = document["stretches"]
    return f"{count(there['before'], 'stretch')} before, {there['after']} after".replace("stretchs", "stretches")


def _who(change: Mapping[str, Any]) -> str:
    return name_at(change)


def _clause(parameter: str, n: Mapping[str, Any]) -> str:
    change = n["change"]
    what = parameter.replace("_", " ")
    if _is_ratio(n):
        return f"({what}) is {number(change['value'])} times what it was"
    if n["before"] is None:
        return f"appeared ({what} {measure(change['value'], change['unit'])})"
    turn = "rose" if change["value"] >= 0.0 else "fell"
    return f"({what}) {turn} by {measure(abs(change['value']), change['unit'])}"


def _is_ratio(n: Mapping[str, Any]) -> bool:
    """Whether the change of a number is its ratio."""
    before, after, change = n["before"], n["after"], n["change"]
    if before is None or after is None or change["unit"] != "1" or before == 0.0:
        return False
    return bool(abs(after / before - change["value"]) < abs(after - before - change["value"]))
