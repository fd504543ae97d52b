"""Update of a diagnosis.json after a test on new runs: probabilities, evidence, groups and the verdict."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95
from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.effect_tests import whole_of
from residual_mpc.experiment.confirmation.inputs import DiagnosedExplanation
from residual_mpc.experiment.confirmation.probabilities import updated
from residual_mpc.experiment.confirmation.records import Confirmation, EffectTest
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.experiment.lasting import lasting
from residual_mpc.models.model_file import values_of
from residual_mpc.models.settings import Knob, Term, Values

Document = Mapping[str, Any]
REPLACED = "Gap and shrink are those of the explanation that was diagnosed first, before {new} replaced {old}."


def explanations_in(document: Document) -> tuple[DiagnosedExplanation, ...]:
    """The explanation of a diagnosis.json as it is at the end of its runs, then its alternatives. Raises KeyError,
    TypeError or ValueError if they cannot be read."""
    explanation, alternatives = lasting(document)
    own = DiagnosedExplanation(terms_in(explanation), (), values_of(document["model"]["values"]))
    others = (
        DiagnosedExplanation(terms_in(a["effects"]), terms_in(a["instead_of"]), values_of(a["values"]))
        for a in alternatives
    )
    return (own, *others)


def sigma_in(document: Document) -> dict[Knob, float]:
    """Standard deviations of the parameters for which a diagnosis.json gives an interval, in their units."""
    out = {}
    for effect in document["explanation"]:
        for name, p in effect["parameters"].items():
            if isinstance(p, dict) and isinstance(p.get("ci95"), list) and None not in p["ci95"]:
                low, high = p["ci95"]
                out[Knob(effect["effect"], effect["target"], name)] = (high - low) / (2.0 * T95)
    return out


def probabilities_in(document: Document) -> dict[Term, float]:
    """Of all candidates and named effects."""
    return {term_in(c): float(c["probability"]) for c in (*document["candidates"], *document["explanation"])}


def confirmed_document(
    document: Document, confirmation: Confirmation, changed: bool, settings: ConfirmationSettings
) -> dict[str, Any]:
    """The diagnosis updated with the test. Its gap figures are still those of its own held-out runs, and its parameters
    are not refitted. changed: whether the robot was changed before the new runs."""
    kept = confirmation.explanations[confirmation.kept]
    replaced = confirmation.kept > 0
    gone = kept.instead_of if replaced else ()
    tests = {t.term: t for t in confirmation.effects}
    probabilities = updated(probabilities_in(document), confirmation, settings)
    named = [_refitted(e, kept.values) for e in document["explanation"] if term_in(e) not in gone]
    explanation = [_supported(e, probabilities[term_in(e)], tests.get(term_in(e))) for e in named]
    if replaced:
        explanation += [_new(t, kept.values, probabilities[t], tests.get(t), changed) for t in kept.terms]
    alternatives = _open_alternatives(document, confirmation)
    groups = _open_groups(document, confirmation)
    verdict, notes = document["verdict"], list(document["notes"])
    if verdict == "effects" and not all(g.as_good for g in confirmation.gaps):
        verdict = "partial"
    if replaced:
        new, old = (" and ".join(t.effect.replace("_", " ") for t in terms) for terms in (kept.terms, gone))
        notes.append(REPLACED.format(new=new, old=old))
    return {
        **document,
        "verdict": verdict,
        "explanation": explanation,
        "candidates": _candidates(document, confirmation, probabilities),
        "rivals": _rivals(document, confirmation),
        "confounded": groups,
        "alternatives": alternatives,
        "model": {**document["model"], "values": _rows(kept.values)} if replaced else document["model"],
        "next_experiment": document["next_experiment"] if groups or alternatives else None,
        "notes": notes,
    }


def _refitted(effect: Document, values: Values) -> dict[str, Any]:
    """An effect with its numbers in the explanation that is kept, which replacing another effect has moved; their
    intervals include both."""
    parameters = {}
    for name, p in effect["parameters"].items():
        value = values.get(Knob(effect["effect"], effect["target"], name)) if isinstance(p, Mapping) else None
        if value is not None and value != p["value"]:
            low, high = p["ci95"] or (None, None)  # an open end stays open
            ends = [None if low is None else min(low, value), None if high is None else max(high, value)]
            ci95 = p["ci95"] and ends
            p = {**p, "value": value, "ci95": ci95}
        parameters[name] = p
    return {**effect, "parameters": parameters}


def _supported(effect: Document, probability: float, test: EffectTest | None) -> dict[str, Any]:
    evidence = list(effect.get("evidence") or [])
    if test is not None and test.outcome == "agrees":
        evidence.append("counterfactual" if test.changed else "experiment")
    return {**effect, "probability": probability, "evidence": list(dict.fromkeys(evidence))}


def _new(term: Term, values: Values, probability: float, test: EffectTest | None, changed: bool) -> dict[str, Any]:
    """An effect that replaces another: its diagnosed value, with the interval from the new runs, extended to include
    it; none if the robot was changed before these runs, or if they do not show it."""
    sizes = {s.name: s for s in test.sizes} if test and not changed else {}
    effect = BY_NAME[term.effect]
    parameters = {}
    for k, value in values.items():
        if Term(k.effect, k.target) == term:
            size = sizes.get(k.parameter)
            known = size is not None and bool(np.isfinite(size.found_ci95).all())
            ci95 = [min(size.found_ci95[0], value), max(size.found_ci95[1], value)] if size and known else None
            unit = effect.parameter(k.parameter).unit if size is None else size.unit
            parameters[k.parameter] = {"value": value, "ci95": ci95, "unit": unit}
    entry = {
        "effect": term.effect, "target": term.target, "probability": probability, "parameters": parameters,
        "evidence": ["fits"], "summary": effect.summary, "only_target": None,
    }  # fmt: skip
    return _supported(entry, probability, test)


def _candidates(
    document: Document, confirmation: Confirmation, probabilities: Mapping[Term, float]
) -> list[dict[str, Any]]:
    rows = [{**c, "probability": probabilities[term_in(c)]} for c in document["candidates"]]
    listed = {term_in(c) for c in rows}
    new = confirmation.explanations[confirmation.kept].terms if confirmation.kept else ()
    rows += [
        {"effect": t.effect, "target": t.target, "probability": probabilities[t], "shrink": None}
        for t in new
        if t not in listed
    ]
    return sorted(rows, key=lambda c: -c["probability"])


def _rivals(document: Document, confirmation: Confirmation) -> list[dict[str, Any]]:
    """The effect sets that were compared as a whole, without those that the new runs exclude; probabilities
    renormalised."""
    own = confirmation.explanations[0]
    gone = {frozenset(whole_of(e, own)) for e in confirmation.explanations if e.excluded}
    kept = [r for r in document.get("rivals", ()) if frozenset(terms_in(r["terms"])) not in gone]
    total = sum(r["probability"] for r in kept) or 1.0
    return [{**r, "probability": r["probability"] / total} for r in kept]


def _open_alternatives(document: Document, confirmation: Confirmation) -> list[dict[str, Any]]:
    """The alternatives that the new runs do not exclude, beside the explanation that is kept."""
    own, *others = (e for e in confirmation.explanations if not e.combined)
    kept = confirmation.explanations[confirmation.kept]
    here = whole_of(kept, own)
    every = {frozenset(whole_of(e, own)): e for e in confirmation.explanations}
    out = []
    for k, (entry, other) in enumerate(zip(document.get("alternatives", ()), others, strict=True), start=1):
        if other.nowhere or k in kept.parts:
            continue
        # on top of what else was exchanged, in place of what the same effects were exchanged for
        there = [confirmation.explanations[p] for p in kept.parts]
        back = [e for e in there if set(e.instead_of) & set(other.instead_of)]
        gone = {t for e in back for t in e.terms} | set(other.instead_of)
        returned = [t for e in back for t in e.instead_of if t not in other.instead_of]
        whole = (*(t for t in here if t not in gone), *returned, *other.terms)
        together = every.get(frozenset(whole))
        if together is not None and together.excluded:
            continue
        effects, instead = ([_named(t) for t in a if t not in b] for a, b in ((whole, here), (here, whole)))
        out.append({**entry, "effects": effects, "instead_of": instead})
        if together is not None:  # else there were too many combinations to test them all
            out[-1]["values"] = _rows(together.values)
    return out


def _open_groups(document: Document, confirmation: Confirmation) -> list[Any]:
    """The confounded groups without the members that the new runs exclude; a group left with one member is dropped."""
    _, *others = (e for e in confirmation.explanations if not e.combined)
    kept = confirmation.explanations[confirmation.kept]
    excluded = {e.terms for e in others if e.nowhere}
    parts = {t for p in kept.parts for t in confirmation.explanations[p].terms}
    gone = set(kept.instead_of) if confirmation.kept else set()
    out = []
    for group in document["confounded"]:
        members = [(m, terms_in([m] if isinstance(m, Mapping) else m)) for m in group]
        left = [m for m, terms in members if terms not in excluded and not gone & set(terms)]
        if confirmation.kept:  # what is named stands first
            left.sort(key=lambda m: not set(terms_in([m] if isinstance(m, Mapping) else m)) <= parts)
        if len(left) > 1:
            out.append(left)
    return out


def _rows(values: Values) -> list[dict[str, Any]]:
    return [{**k._asdict(), "value": v} for k, v in values.items()]


def _named(term: Term) -> dict[str, Any]:
    return {"effect": term.effect, "target": term.target}


def term_in(entry: Document) -> Term:
    """The effect and target of an entry of diagnosis.json."""
    return Term(entry["effect"], entry["target"])


def terms_in(entries: Sequence[Document]) -> tuple[Term, ...]:
    """Those of several entries."""
    return tuple(term_in(e) for e in entries)
