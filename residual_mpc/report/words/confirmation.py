"""The result of testing a diagnosis on new runs, in words."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.report.words.effects import name_at
from residual_mpc.report.words.numbers import count, listed, measure, measure_interval, number, percent, plain
from residual_mpc.report.words.summary import sentence

Document = Mapping[str, Any]  # the "confirmation" of a diagnosis.json

OUTCOMES = {
    "agrees": "confirmed",
    "other size": "present, but with a different size",
    "denies": "not supported",
    "open": "undecided on these runs",
}
MASKED = (
    "Even refitted, the model leaves more than the noise on these runs: what it lacks may look like the effects that "
    "it names, so only a known change can confirm them."
)
LITTLE = 0.1  # share of the nominal gap below which a reduction says nothing


def confirmation_sentence(document: Document) -> str:
    """What the new runs decide, in one sentence."""
    by = {outcome: [e for e in document["effects"] if e["outcome"] == outcome] for outcome in OUTCOMES}
    clauses = [
        f"{verb} {listed([name_at(e) for e in by[outcome]])}"
        for outcome, verb in (
            ("agrees", "confirm"),
            ("other size", "give a different size for"),
            ("denies", "count against"),
        )
        if by[outcome]
    ]
    kept = next(e for e in document["explanations"] if e["kept"])
    there = {name_at(e) for e in (*kept["effects"], *by["denies"])}
    gone = [name_at(e) for row in document["explanations"] if row["excluded"] for e in row["with"]]
    excluded = [name for name in dict.fromkeys(gone) if name not in there]
    if excluded:
        clauses.append(f"exclude {listed(excluded)}")
    said = _prediction(document["gaps"][0], _model(document))
    if not clauses:
        decided = f"The new runs neither confirm nor contradict the diagnosis; {said}."
    else:
        decided = f"The new runs {listed(clauses)}; {said}."
    masked = any(not e["changed"] for e in by["open"]) and not document["explains_all"]
    return f"{decided} {MASKED}" if masked else decided


def confirmed_sentence(document: Mapping[str, Any], verdict_before: str) -> str:
    """The verdict of a diagnosis.json that was tested, in one sentence, or two if the new runs lowered it."""
    if document["verdict"] == verdict_before:
        return sentence(document)
    worst = max(document["confirmation"]["gaps"], key=lambda g: g["explained"] / max(g["noise_floor"], 1e-12))
    left, floor = number(worst["explained"]), number(worst["noise_floor"], 2)
    more = f"{left} over {number(worst['horizon'])} s (noise floor {floor})"
    return f"{sentence({**document, 'verdict': verdict_before})} The new runs leave a larger gap: {more}."


def confirmation_lines(document: Document) -> list[str]:
    """The sentence, then a line for each gap, effect and explanation, for a terminal."""
    details = [
        *(changed_words(c) for c in document["changed"]),
        *(gap_words(g, _model(document)) for g in document["gaps"]),
        *(effect_words(e) for e in document["effects"]),
        *(explanation_words(e) for e in document["explanations"] if len(document["explanations"]) > 1),
    ]
    return [plain(confirmation_sentence(document)), *(f"  {plain(line)}" for line in details)]


def changed_words(change: Document) -> str:
    """ "changed before the new runs: payload, mass increased by 200 g"."""
    if change["value"] is None:
        return f"changed before the new runs: {name_at(change)} removed"
    if change["relative"]:
        turned = "increased" if change["value"] >= 0.0 else "decreased"
        how = f"{change['parameter']} {turned} by {measure(abs(change['value']), change['unit'])}"
    else:
        how = f"{change['parameter']} set to {measure(change['value'], change['unit'])}"
    return f"changed before the new runs: {name_at(change)}, {how}"


def gap_words(gap: Document, model: str) -> str:
    """ "gap on the new runs at 1 s: nominal 0.31, diagnosed 0.021 (noise floor 0.02), 18 windows"."""
    figures = f"nominal {number(gap['nominal'])}, {model} {number(gap['explained'])}"
    floor = f"noise floor {number(gap['noise_floor'], 2)}"
    return f"gap on the new runs at {number(gap['horizon'])} s: {figures} ({floor}), {count(gap['windows'], 'window')}"


def effect_words(effect: Document) -> str:
    """ "command delay: confirmed; delay 88 ms (86 to 90), expected 88 ms (71 to 105); probability 0.45 → 0.96"."""
    parts = [OUTCOMES[effect["outcome"]], *size_words(effect)]
    before, after = effect["probability"]["before"], effect["probability"]["after"]
    parts.append(f"probability {before:.2f} \N{RIGHTWARDS ARROW} {after:.2f}")
    return f"{name_at(effect)}: {'; '.join(parts)}"


def size_words(effect: Document) -> list[str]:
    """ "delay 88 ms (86 to 90), expected 88 ms (71 to 105)", for each parameter."""
    return [
        f"{name.replace('_', ' ')} {_found(p)}, expected "
        + measure_interval(p["expected"], p["expected_ci95"], p["unit"])
        for name, p in effect["parameters"].items()
    ]


def explanation_words(explanation: Document) -> str:
    """ "with sensor delay instead of command delay: gap 0.31, excluded (score 540 above the lowest)"."""
    status = explanation_status(explanation)
    difference = explanation["score_difference"]
    above = f" (score {number(difference, 2)} above the lowest)" if difference else " (lowest score)"
    if explanation["kept"]:
        above = ""
    return f"{explanation_name(explanation)}: gap {number(explanation['gap'])}, {status}{above}"


def explanation_status(explanation: Document) -> str:
    """ "kept", "excluded" or "not excluded"."""
    return "kept" if explanation["kept"] else "excluded" if explanation["excluded"] else "not excluded"


def explanation_name(explanation: Document) -> str:
    """ "diagnosed explanation", "with sensor delay instead of command delay"."""
    if not explanation["instead_of"] and explanation["with"] == explanation["effects"]:
        return "diagnosed explanation"
    instead = listed([name_at(e) for e in explanation["instead_of"]])
    return f"with {listed([name_at(e) for e in explanation['with']])} " + (
        f"instead of {instead}" if instead else "in addition"
    )


def _model(document: Document) -> str:
    """Which model the gaps are of."""
    return "diagnosed" if document["explanations"][0]["kept"] else "replacing"


def _prediction(gap: Document, model: str) -> str:
    """ "the diagnosed model removes 92 % of their gap"."""
    removed = 1.0 - gap["explained"] / max(gap["nominal"], 1e-12)
    if removed < -LITTLE:
        return f"the {model} model predicts them worse than the nominal one (gap {number(gap['explained'])})"
    if removed < LITTLE:
        return f"the {model} model predicts them no better than the nominal one"
    return f"the {model} model removes {percent(removed)} of their gap"


def _found(p: Document) -> str:
    if None in p["found_ci95"]:
        return "not determined by these runs"
    return measure_interval(p["found"], p["found_ci95"], p["unit"])
