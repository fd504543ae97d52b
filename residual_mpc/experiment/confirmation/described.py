"""The object `confirmation` of a diagnosis.json: what was tested on the new runs, and with what result."""

from collections.abc import Mapping, Sequence
from typing import Any

from residual_mpc.effects.library import BY_NAME
from residual_mpc.experiment.confirmation.effect_tests import whole_of
from residual_mpc.experiment.confirmation.known_change import KnownChange
from residual_mpc.experiment.confirmation.records import Confirmation, EffectTest, ExplanationTest
from residual_mpc.models.parameter_units import unit_of
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Term


def described(
    confirmation: Confirmation,
    robot: Robot,
    before: Mapping[Term, float],
    after: Mapping[Term, float],
    changes: Sequence[KnownChange],
    runs: Sequence[str],
) -> dict[str, Any]:
    """before, after: probabilities of the effects."""
    own = confirmation.explanations[0]
    kept = confirmation.explanations[confirmation.kept]
    return {
        "runs": list(runs),
        "changed": [_change(c, robot) for c in changes],
        "effects": [_effect(t, before.get(t.term, 0.0), after.get(t.term, 0.0)) for t in confirmation.effects],
        "explanations": [
            _explanation(e, own, e is kept)
            for e in confirmation.explanations
            if e is kept or not (e.combined or (kept.combined and set(e.parts) & set(kept.parts)))
        ],
        "gaps": [
            {"horizon": g.horizon, "windows": g.windows, "nominal": g.nominal, "explained": g.explained,
             "noise_floor": g.noise_floor, "as_good_as_told": g.as_good}
            for g in confirmation.gaps
        ],
        "explains_all": confirmation.whole,
    }  # fmt: skip


def _change(change: KnownChange, robot: Robot) -> dict[str, Any]:
    unit = unit_of(robot, change.term, BY_NAME[change.knob.effect].parameter(change.knob.parameter).unit)
    said = {"parameter": change.knob.parameter, "value": change.amount, "relative": change.relative, "unit": unit}
    return {**_named(change.term), **said}


def _effect(test: EffectTest, before: float, after: float) -> dict[str, Any]:
    parameters = {
        s.name: {"expected": s.expected, "expected_ci95": list(s.expected_ci95), "found": s.found,
                 "found_ci95": list(s.found_ci95), "unit": s.unit}
        for s in test.sizes
    }  # fmt: skip
    return {
        **_named(test.term),
        "outcome": test.outcome,
        "changed": test.changed,
        "new": test.new,
        "score_difference": test.difference,
        "probability": {"before": before, "after": after},
        "parameters": parameters,
    }


def _explanation(e: ExplanationTest, own: ExplanationTest, kept: bool) -> dict[str, Any]:
    return {
        "effects": [_named(t) for t in whole_of(e, own)],
        "with": [_named(t) for t in e.terms],
        "instead_of": [_named(t) for t in e.instead_of],
        "gap": e.gap,
        "gap_refitted": e.refitted,
        "score_difference": e.above,
        "excluded": e.nowhere,
        "kept": kept,
    }


def _named(term: Term) -> dict[str, Any]:
    return {"effect": term.effect, "target": term.target}
