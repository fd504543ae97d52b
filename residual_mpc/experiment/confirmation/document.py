"""A diagnosis.json with what new runs say of it: probabilities, evidence, groups and the verdict."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.inputs import DiagnosedExplanation
from residual_mpc.experiment.confirmation.known_change import KnownChange
from residual_mpc.experiment.confirmation.records import Confirmation, EffectTest, NewGap
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.model_file import values_of
from residual_mpc.models.settings import Knob, Term, Values

Document = Mapping[str, Any]


def explanations_in(document: Document) -> tuple[DiagnosedExplanation, ...]:
    """The explanation of a diagnosis.json, then its alternatives. Raises KeyError, TypeError or ValueError where they
    cannot be read."""
    own = DiagnosedExplanation(_terms(document["explanation"]), (), values_of(document["model"]["values"]))
    others = (
        DiagnosedExplanation(_terms(a["effects"]), _terms(a["instead_of"]), values_of(a["values"]))
        for a in document.get("alternatives", ())
    )
    return (own, *others)


def sigma_in(document: Document) -> dict[Knob, float]:
    """1-sigma of the numbers that a diagnosis.json gives an interval, in their units."""
    out = {}
    for effect in document["explanation"]:
        for name, p in effect["parameters"].items():
            if isinstance(p, dict) and isinstance(p.get("ci95"), list) and None not in p["ci95"]:
                low, high = p["ci95"]
                out[Knob(effect["effect"], effect["target"], name)] = (high - low) / (2.0 * 1.96)
    return out


def confirmed_document(
    document: Document,
    confirmation: Confirmation,
    changes: Sequence[KnownChange],
    runs: Sequence[str],
    settings: ConfirmationSettings,
) -> dict[str, Any]:
    """The diagnosis as it stands after the new runs. Its figures stay those of its own held-out runs."""
    best = confirmation.explanations[confirmation.best]
    tests = {t.term: t for t in confirmation.effects}
    totals = _totals(document, confirmation)
    probabilities = {t: _probability(totals[t], tests.get(t), settings) for t in totals}
    kept = [e for e in document["explanation"] if confirmation.best == 0 or _term(e) not in best.instead_of]
    explanation = [_supported(e, probabilities[_term(e)], tests.get(_term(e))) for e in kept]
    if confirmation.best:
        explanation += [_new(t, best.values, probabilities[t], tests.get(t)) for t in best.terms]
    left = [e for k, e in enumerate(confirmation.explanations) if k and k != confirmation.best and not e.excluded]
    groups = _open_groups(document, left, confirmation)
    verdict = document["verdict"]
    if verdict == "effects" and not _holds(confirmation.gaps):
        verdict = "partial"
    still = {(a.terms, a.instead_of) for a in left}
    replaced = confirmation.best > 0
    return {
        **document,
        "verdict": verdict,
        "explanation": explanation,
        "candidates": _candidates(document, probabilities),
        "rivals": _rivals(document, confirmation),
        "confounded": groups,
        "alternatives": [
            a
            for a in document.get("alternatives", ())
            if not replaced and (_terms(a["effects"]), _terms(a["instead_of"])) in still
        ],
        "model": {**document["model"], "values": _rows(best.values)} if replaced else document["model"],
        "next_experiment": document["next_experiment"] if groups or left else None,
        "confirmation": _confirmation(confirmation, document, probabilities, changes, runs),
    }


def _totals(document: Document, confirmation: Confirmation) -> dict[Term, float]:
    """The probability of each effect before its own test: a group whose other members the new runs exclude leaves the
    one that stands what they had."""
    listed = {_term(c): float(c["probability"]) for c in document["candidates"]}
    listed |= {_term(e): float(e["probability"]) for e in document["explanation"]}
    best = confirmation.explanations[confirmation.best]
    totals = dict(listed)
    for k, other in enumerate(confirmation.explanations):
        if k == 0 or k == confirmation.best or not other.excluded:
            continue
        for term in other.instead_of:
            if confirmation.best == 0 and term in totals:
                totals[term] += min((listed.get(t, 0.0) for t in other.terms), default=0.0)
    if confirmation.best:
        taken = min((listed.get(t, 0.0) for t in best.instead_of), default=0.0)
        for term in best.terms:
            totals[term] = listed.get(term, 0.0) + taken
    return totals


def _probability(total: float, test: EffectTest | None, settings: ConfirmationSettings) -> float:
    """By Bayes' rule from how often new runs agree with, or deny, an effect that is there and one that is not."""
    most = settings.results.causes.most_sure
    total = min(total, most)
    rates = {"agrees": settings.agrees, "denies": settings.denies}.get(test.outcome) if test else None
    if rates is None:
        return total
    there, absent = total * rates[0], (1.0 - total) * rates[1]
    return min(there / (there + absent), most)


def _supported(effect: Document, probability: float, test: EffectTest | None) -> dict[str, Any]:
    evidence = list(effect.get("evidence") or [])
    if test is not None and test.outcome == "agrees":
        evidence.append("counterfactual" if test.changed else "experiment")
    return {**effect, "probability": probability, "evidence": list(dict.fromkeys(evidence))}


def _new(term: Term, values: Values, probability: float, test: EffectTest | None) -> dict[str, Any]:
    """An effect that takes the place of another, with the interval that the new runs give it."""
    sizes = {s.name: s for s in test.sizes} if test else {}
    effect = BY_NAME[term.effect]
    parameters = {}
    for k, value in values.items():
        if Term(k.effect, k.target) == term:
            size = sizes.get(k.parameter)
            ci95 = None if size is None else [min(size.found_ci95[0], value), max(size.found_ci95[1], value)]
            unit = effect.parameter(k.parameter).unit if size is None else size.unit
            parameters[k.parameter] = {"value": value, "ci95": ci95, "unit": unit}
    entry = {
        "effect": term.effect, "target": term.target, "probability": probability, "parameters": parameters,
        "evidence": ["fits"], "summary": effect.summary, "only_target": None,
    }  # fmt: skip
    return _supported(entry, probability, test)


def _candidates(document: Document, probabilities: Mapping[Term, float]) -> list[dict[str, Any]]:
    rows = [{**c, "probability": probabilities.get(_term(c), c["probability"])} for c in document["candidates"]]
    return sorted(rows, key=lambda c: -c["probability"])


def _rivals(document: Document, confirmation: Confirmation) -> list[dict[str, Any]]:
    """The sets that were compared as wholes, less those that the new runs exclude."""
    own = confirmation.explanations[0].terms
    gone = {
        frozenset(own if k == 0 else (*(t for t in own if t not in e.instead_of), *e.terms))
        for k, e in enumerate(confirmation.explanations)
        if e.excluded
    }
    kept = [r for r in document.get("rivals", ()) if frozenset(_terms(r["terms"])) not in gone]
    total = sum(r["probability"] for r in kept) or 1.0
    return [{**r, "probability": r["probability"] / total} for r in kept]


def _open_groups(document: Document, left: Sequence[Any], confirmation: Confirmation) -> list[Any]:
    """The groups less the members that the new runs exclude; one of a single member is none."""
    open_ = {e.terms for e in left}
    stands = confirmation.explanations[confirmation.best]
    out = []
    for group in document["confounded"]:
        kept = []
        for member in group:
            terms = _terms([member] if isinstance(member, Mapping) else member)
            own = set(terms) <= {_term(e) for e in document["explanation"]}
            if (own and not (confirmation.best and set(terms) & set(stands.instead_of))) or terms in open_:
                kept.append(member)
            elif confirmation.best and terms == stands.terms:
                kept.insert(0, member)
        if len(kept) > 1:
            out.append(kept)
    return out


def _holds(gaps: Sequence[NewGap]) -> bool:
    return all(g.as_told for g in gaps)


def _confirmation(
    confirmation: Confirmation,
    document: Document,
    probabilities: Mapping[Term, float],
    changes: Sequence[KnownChange],
    runs: Sequence[str],
) -> dict[str, Any]:
    was = {_term(c): float(c["probability"]) for c in (*document["candidates"], *document["explanation"])}
    own = confirmation.explanations[0].terms
    rows = []
    for k, e in enumerate(confirmation.explanations):
        whole = e.terms if k == 0 else (*(t for t in own if t not in e.instead_of), *e.terms)
        rows.append({
            "effects": [_named(t) for t in whole], "with": [_named(t) for t in e.terms],
            "instead_of": [_named(t) for t in e.instead_of], "gap": e.gap, "gap_refitted": e.refitted, "ratio": e.ratio,
            "excluded": e.excluded, "stands": k == confirmation.best,
        })  # fmt: skip
    return {
        "runs": list(runs),
        "changed": [
            {**_named(c.term), "parameter": c.knob.parameter, "value": c.amount, "relative": c.relative,
             "unit": BY_NAME[c.knob.effect].parameter(c.knob.parameter).unit}
            for c in changes
        ],
        "effects": [
            {
                **_named(t.term), "outcome": t.outcome, "changed": t.changed, "new": t.new, "ratio": t.ratio,
                "probability": {"before": was.get(t.term, 0.0), "after": probabilities.get(t.term, 0.0)},
                "parameters": {
                    s.name: {"expected": s.expected, "expected_ci95": list(s.expected_ci95), "found": s.found,
                             "found_ci95": list(s.found_ci95), "unit": s.unit}
                    for s in t.sizes
                },
            }
            for t in confirmation.effects
        ],
        "explanations": rows,
        "gaps": [
            {"horizon": g.horizon, "windows": g.windows, "nominal": g.nominal, "explained": g.explained,
             "noise_floor": g.noise_floor}
            for g in confirmation.gaps
        ],
    }  # fmt: skip


def _rows(values: Values) -> list[dict[str, Any]]:
    return [{**k._asdict(), "value": v} for k, v in values.items()]


def _named(term: Term) -> dict[str, Any]:
    return {"effect": term.effect, "target": term.target}


def _term(entry: Document) -> Term:
    return Term(entry["effect"], entry["target"])


def _terms(entries: Sequence[Document]) -> tuple[Term, ...]:
    return tuple(_term(e) for e in entries)
