"""A comparison as the JSON that scripts rely on (contract, section 8)."""

from collections.abc import Mapping
from typing import Any

from residual_mpc.comparison.records import ChangedNumber, Comparison, Predicted
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.diagnosis.results.document import finite
from residual_mpc.models.settings import Term

SCHEMA = "residual-mpc/comparison/1"


def to_document(c: Comparison) -> dict[str, Any]:
    """comparison.json as plain lists, dicts and numbers; no NaN or infinity."""
    document = {
        "schema": SCHEMA,
        "robot": c.robot,
        "verdict": c.verdict,
        "changes": [
            {
                **_term(change.term),
                "probability": change.probability,
                "parameters": {n.name: _number(n) for n in change.parameters},
                "p": change.p,
                "summary": change.summary,
                "only_target": change.only_target,
                "predicts": _predicted(c.gap.predicted, change.term),
            }
            for change in c.changes
        ],
        "confounded": [[_member(m) for m in group] for group in c.groups],
        "candidates": [{**_term(x.term), "probability": x.probability, "p": x.p} for x in c.candidates],
        "gap": {
            "before": c.gap.before,
            "after": c.gap.after,
            "after_explained": c.gap.after_explained,
            "noise_floor": c.gap.noise_floor,
            "nominal": {"before": c.gap.nominal_before, "after": c.gap.nominal_after},
            "horizon": c.gap.horizon,
            "windows": {"before": c.gap.windows[0], "after": c.gap.windows[1]},
            "folds": c.gap.folds,
            "channels": c.gap.channels,
        },
        "unexplained": {"share": c.unexplained, "p": c.p_left},
        "not_testable": [{**_term(n.term), "why": n.why} for n in c.not_testable],
        "visible": [{**_term(v.term), "parameters": {v.name: {"change": v.size, "unit": v.unit}}} for v in c.visible],
        "account": [_term(t) for t in c.account],
        "stretches": {"before": c.units[0], "after": c.units[1]},
        "next_experiment": c.next_experiment,
        "notes": list(c.notes),
    }
    clean: dict[str, Any] = finite(document)
    return clean


def _predicted(predicted: Mapping[Term, Predicted], term: Term) -> dict[str, float] | None:
    found = predicted.get(term._replace(changed=True))
    return None if found is None else {"gain": found.gain, "error": found.error, "better": found.better}


def _number(n: ChangedNumber) -> dict[str, Any]:
    change = {"value": n.change, "ci95": list(n.ci95), "unit": n.unit}
    return {"before": n.before, "after": n.after, "change": change, **({"note": n.note} if n.note else {})}


def _term(term: Term) -> dict[str, Any]:
    return {"effect": term.effect, "target": term.target}


def _member(member: EffectSet) -> Any:
    """One effect as itself, several as a list."""
    terms = [_term(t) for t in member]
    return terms[0] if len(terms) == 1 else terms
