"""A diagnosis as the JSON that scripts rely on, and the augmented model that `gap --model` reads back."""

import math
from dataclasses import asdict
from typing import Any

from residual_mpc.diagnosis.laws.figures import FittedLaw
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.diagnosis.results.records import Diagnosis, Estimate, GapFigures
from residual_mpc.effects.laws import published
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.model_file import DIAGNOSIS_SCHEMA, MODEL_SCHEMA
from residual_mpc.models.settings import Term, Values

NEW_READINGS = ("nominal", "before", "after", "noise_floor", "windows", "horizons")  # figures of a gap


def to_document(d: Diagnosis) -> dict[str, Any]:
    """diagnosis.json as plain lists, dicts and numbers; no NaN or infinity."""
    expected = d.expected
    shrink = None
    if expected is not None and d.achieved is not None:
        shrink = {
            "expected": expected.value,
            "expected_ci95": list(expected.ci95),
            "value": d.achieved.value,
            "ci95": list(d.achieved.ci95),
        }
    document = {
        "schema": DIAGNOSIS_SCHEMA,
        "robot": d.robot,
        "verdict": d.verdict,
        "held_out": [k.document() for k in d.held_out],
        "gap": _gap(d.gap),
        "shrink": shrink,
        "where": {
            "stages": [{"name": s.name, "share": s.share} for s in d.stages],
            "channels": [{"name": n, "share": s} for n, s in d.where.channels],
            "regimes": [{"name": r.name, "share": r.share, "lift": r.lift} for r in d.where.regimes],
            "times": [{"run": s.run, "from": s.start, "to": s.end, "share": s.share} for s in d.where.times],
        },
        "explanation": [
            {
                **_term(c.term),
                "probability": c.probability,
                **(
                    {"parameters": {p.name: _estimate(p) for p in c.parameters}}
                    if c.law is None
                    else _law(c.term, c.law)
                ),
                "evidence": list(c.evidence),
                "summary": c.summary,
                "only_target": c.only_target,
                **({} if c.variation is None else c.variation.document()),
            }
            for c in d.causes
        ],
        "candidates": [{**_term(c.term), "probability": c.probability, "shrink": c.shrink} for c in d.candidates],
        "confounded": [[_member(m) for m in group] for group in d.groups],
        "not_testable": [{**_term(n.term), "why": n.why} for n in d.not_testable],
        "moved": [{"parameter": m.parameter, "from": m.before, "to": m.after} for m in d.moved],
        "unexplained": {"share": d.unexplained, "learned_residual_shrink": d.learned.shrink},
        "learned": {"by": d.learned.by, "asked": list(d.learned.asked)},
        "remainder": None if d.rest is None else d.rest.document(),
        "odd_run": d.odd_run,
        "unlike_the_rest": d.unlike,
        "next_experiment": d.next_experiment,
        "stages_of_gap": [{"terms": [_term(t) for t in s.effects], "gap": s.gap} for s in d.steps],
        "rivals": [{"terms": [_term(t) for t in r.effects], "probability": r.probability} for r in d.rivals],
        "alternatives": [
            {
                "effects": [_term(t) for t in a.terms],
                "instead_of": [_term(t) for t in a.instead_of],
                "ratio": a.ratio,
                "confounded": a.confounded,
                "values": _rows(a.values),
            }
            for a in d.alternatives
        ],
        "setup": {
            **asdict(d.setup),
            "commands": {a: {"low": low, "high": high} for a, (low, high) in d.setup.commands.items()},
        },
        "outliers": {"share": d.outlier_share, "channels": d.outlier_channels} if d.outlier_share > 0 else None,
        "model": to_model(d),
        "notes": list(d.notes),
    }
    clean: dict[str, Any] = finite(document)
    return clean


def to_model(d: Diagnosis) -> dict[str, Any]:
    """The augmented model: every value that differs from the nominal one at the end of the runs."""
    outliers = any(not BY_NAME[c.term.effect].fitted for c in d.causes)
    return {
        "schema": MODEL_SCHEMA,
        "robot": d.robot,
        "values": _rows(d.last_values),
        "leaves_out_outliers": outliers,
    }


def _gap(gap: GapFigures) -> dict[str, Any]:
    new = None if gap.new_readings is None else _gap(gap.new_readings)
    return {
        "nominal": gap.nominal,
        "before": gap.before,
        "after": gap.after,
        "noise_floor": gap.noise_floor,
        "horizon": gap.horizon,
        "windows": gap.windows,
        "skipped": gap.skipped,
        "still": list(gap.still),
        "channels": {c: {"before": b, "after": a, "noise_floor": f} for c, (b, a, f) in gap.channels.items()},
        "horizons": [h.document() for h in gap.horizons],
        "constant_velocity": gap.constant_velocity,
        "step_error": gap.step_error,
        "own_step": gap.own_step,
        "blinded": gap.blinded,
        "new_readings": None if new is None else {k: new[k] for k in NEW_READINGS},
    }


def _law(term: Term, law: FittedLaw) -> dict[str, Any]:
    return {"stage": BY_NAME[term.effect].stage, **law.document()}


def _estimate(p: Estimate) -> dict[str, Any]:
    figures = {"value": p.value, "ci95": list(p.ci95), "unit": p.unit}
    return {**figures, "note": p.note} if p.note else figures


def _rows(values: Values) -> list[dict[str, Any]]:
    return [{**k._asdict(), "value": v} for k, v in values.items()]


def _term(term: Term) -> dict[str, str | None]:
    return {"effect": published(term.effect), "target": term.target}


def _member(member: EffectSet) -> Any:
    return _term(member[0]) if len(member) == 1 else [_term(t) for t in member]


def finite(x: Any) -> Any:
    """The same structure with null for what JSON has no number for."""
    if isinstance(x, dict):
        return {k: finite(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [finite(v) for v in x]
    if isinstance(x, float):
        return x if math.isfinite(x) else None
    return x.item() if hasattr(x, "item") else x
