"""What supports each named effect, beyond a better fit, and what casts doubt on it (contract, section 5: evidence)."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.explained import Explained
from residual_mpc.diagnosis.fit import Fit
from residual_mpc.diagnosis.gap import gap_of
from residual_mpc.diagnosis.how_far import fold_values
from residual_mpc.diagnosis.replay import predict
from residual_mpc.diagnosis.rest.records import Rest
from residual_mpc.diagnosis.search import window_trust, without
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term

KEPT = 0.3  # of its distance from null that a number keeps when any run is left out
DEPENDS = 0.2  # share of a remainder from which its dependence casts doubt
UNSUPPORTED = 0.5  # factor on the probability of an effect that does not help on unseen windows, or is imitated

# What a remainder that depends on this quantity is easily mistaken for: a steady effect fitted to a changing one.
IMITATED: Mapping[str, frozenset[str]] = {
    **dict.fromkeys(
        ("time", "order", "run", "work"),
        frozenset({"voltage_sag", "actuator_gain", "wheel_radius", "coulomb_friction", "viscous_friction"}),
    ),
    **dict.fromkeys(
        ("position", "angle"),
        frozenset(
            {"actuator_gain", "coulomb_friction", "load_dependent_friction", "payload", "link_mass", "sensor_bias"}
        ),
    ),
    "speed": frozenset({"actuator_gain", "wheel_radius", "viscous_friction"}),
}


def evidence_of(of: Explained) -> dict[Term, tuple[str, ...]]:
    """For each named effect: "fits" (better beyond doubt: the search asks for that), "predicts" (better on the windows
    that are judged, which no fit has seen), "survives" (still there when any one run is left out)."""
    helps, lasts = _predicts(of), _survives(of.problem.data.run, of.final)
    return {
        t: ("fits", *(("predicts",) if helps[t] else ()), *(("survives",) if lasts[t] else ())) for t in of.final.terms
    }


def doubts(terms: tuple[Term, ...], evidence: Mapping[Term, tuple[str, ...]], rest: Rest | None) -> dict[Term, float]:
    """A factor on the probability of each effect."""
    on = set() if rest is None else {d.kind for d in rest.depends if d.share >= DEPENDS}
    imitated = frozenset[str]().union(*(IMITATED.get(kind, frozenset()) for kind in on))
    return {
        t: (1.0 if "predicts" in evidence[t] else UNSUPPORTED) * (UNSUPPORTED if t.effect in imitated else 1.0)
        for t in terms
    }


def _predicts(of: Explained) -> dict[Term, bool]:
    terms = of.final.terms
    if not terms:
        return {}
    data = of.after_data.take(of.test)
    rows = [of.final.values, *(without(of.final.values, t) for t in terms)]
    errors = [data.y - p for p in predict(data, of.space.settings(rows))]
    trust = window_trust(data, of.scales, errors[0])
    whole, *less = [gap_of(data, of.scales, e, trust).total for e in errors]
    return {t: bool(x > whole) for t, x in zip(terms, less, strict=True)}


def _survives(run: np.ndarray, final: Fit) -> dict[Term, bool]:
    """By one Gauss-Newton step without each run."""
    present, fold = np.unique(run, return_inverse=True)
    if len(present) < 2 or not final.terms:
        return dict.fromkeys(final.terms, False)
    every = fold_values(final, fold)
    out = {}
    for term in final.terms:
        good = True
        for k in final.knobs:
            if k.effect == TUNE or k.term != term:
                continue
            p = BY_NAME[k.effect].parameter(k.parameter)
            if p.shape or final.values[k] == p.null:
                continue
            if np.isfinite(p.null):
                kept = [(v[k] - p.null) / (final.values[k] - p.null) for v in every]
            else:
                kept = [final.values[k] / v[k] if v[k] > 0.0 else 0.0 for v in every]
            good &= min(kept) >= KEPT
        out[term] = bool(good)
    return out
