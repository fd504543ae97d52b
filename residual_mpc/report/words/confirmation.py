"""What new runs say about a diagnosis, in words."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.words.effects import name_at
from residual_mpc.report.words.numbers import ARROW, count, listed, measure, measure_interval, number, plain

Document = Mapping[str, Any]  # the "confirmation" of a diagnosis.json

OUTCOMES = {
    "agrees": "confirmed",
    "other size": "there, but of another size",
    "denies": "not supported",
    "open": "not settled by these runs",
}


def confirmation_sentence(document: Document) -> str:
    """What the new runs settle, in one sentence."""
    by = {outcome: [e for e in document["effects"] if e["outcome"] == outcome] for outcome in OUTCOMES}
    clauses = [
        f"{verb} {listed([name_at(e) for e in by[outcome]])}"
        for outcome, verb in (
            ("agrees", "confirm"),
            ("other size", "show another size of"),
            ("denies", "speak against"),
        )
        if by[outcome]
    ]
    stands = next(e for e in document["explanations"] if e["stands"])
    there = {name_at(e) for e in (*stands["effects"], *by["denies"])}
    gone = [name_at(e) for row in document["explanations"] if row["excluded"] for e in row["with"]]
    excluded = [name for name in dict.fromkeys(gone) if name not in there]
    if excluded:
        clauses.append(f"exclude {listed(excluded)}")
    if not clauses:
        return "The new runs do not show whether the diagnosis is right."
    return f"The new runs {listed(clauses)}."


def confirmation_lines(document: Document) -> list[str]:
    """The sentence, then a line for each gap, effect and explanation, for a terminal."""
    details = [
        *(changed_words(c) for c in document["changed"]),
        *(gap_words(g) for g in document["gaps"]),
        *(effect_words(e) for e in document["effects"]),
        *(explanation_words(e) for e in document["explanations"] if len(document["explanations"]) > 1),
    ]
    return [plain(confirmation_sentence(document)), *(f"  {plain(line)}" for line in details)]


def changed_words(change: Document) -> str:
    """ "changed before the new runs: payload, mass increased by 200 g"."""
    if change["value"] is None:
        how = "removed"
    elif change["relative"]:
        turned = "increased" if change["value"] >= 0.0 else "decreased"
        how = f"{change['parameter']} {turned} by {measure(abs(change['value']), change['unit'])}"
    else:
        how = f"{change['parameter']} set to {measure(change['value'], change['unit'])}"
    return f"changed before the new runs: {name_at(change)}, {how}"


def gap_words(gap: Document) -> str:
    """ "gap on the new runs at 1 s: 0.31 → 0.021 (noise floor 0.02), 18 windows"."""
    figures = f"{number(gap['nominal'])} {ARROW} {number(gap['explained'])}"
    floor = f"noise floor {number(gap['noise_floor'], 2)}"
    return f"gap on the new runs at {number(gap['horizon'])} s: {figures} ({floor}), {count(gap['windows'], 'window')}"


def effect_words(effect: Document) -> str:
    """ "command delay: confirmed; delay 88 ms (86 to 90), expected 88 ms (71 to 105); probability 0.45 → 0.96"."""
    parts = [OUTCOMES[effect["outcome"]], *size_words(effect)]
    before, after = effect["probability"]["before"], effect["probability"]["after"]
    parts.append(f"probability {before:.2f} {ARROW} {after:.2f}")
    return f"{name_at(effect)}: {'; '.join(parts)}"


def size_words(effect: Document) -> list[str]:
    """ "delay 88 ms (86 to 90), expected 88 ms (71 to 105)", for each number."""
    return [
        f"{name.replace('_', ' ')} {_found(p)}, expected "
        + measure_interval(p["expected"], p["expected_ci95"], p["unit"])
        for name, p in effect["parameters"].items()
    ]


def explanation_words(explanation: Document) -> str:
    """ "with sensor delay instead of command delay: gap 0.31, excluded (likelihood ratio 540)"."""
    said = "stands" if explanation["stands"] else "excluded" if explanation["excluded"] else "not excluded"
    ratio = "" if explanation["stands"] else f" (likelihood ratio {number(explanation['ratio'], 2)})"
    return f"{explanation_name(explanation)}: gap {number(explanation['gap'])}, {said}{ratio}"


def explanation_name(explanation: Document) -> str:
    """ "as diagnosed", "with sensor delay instead of command delay"."""
    if not explanation["instead_of"] and explanation["with"] == explanation["effects"]:
        return "as diagnosed"
    instead = listed([name_at(e) for e in explanation["instead_of"]])
    return f"with {listed([name_at(e) for e in explanation['with']])}" + (f" instead of {instead}" if instead else "")


def _found(p: Document) -> str:
    if None in p["found_ci95"]:
        return "unknown"
    return measure_interval(p["found"], p["found_ci95"], p["unit"])
