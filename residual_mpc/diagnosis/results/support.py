"""What supports each named effect, beyond a better fit, and what casts doubt on it (contract, section 5: evidence)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, fit_trust, gap_of
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.cross_validation import fold_values
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.horizons import HorizonWindows
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.remainder.records import Rest
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.readjusted import readjusted
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.verdict import HorizonGaps
from residual_mpc.effects.laws import is_law, quantities_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term, Values

# What the kinds of dependence of a remainder amount to (see Effect.imitates): a steady effect that is fitted to a
# changing one is mistaken for it.
DEPENDENCE: Mapping[str, str] = {
    **dict.fromkeys(("time", "order", "run", "work"), "time"),
    **dict.fromkeys(("position", "angle"), "position"),
    "speed": "speed",
    "turning": "turning",
    "load": "load",
}


@dataclass(frozen=True)
class Support:
    """What supports one effect. evidence: "fits" (better beyond doubt: the search asks for that), "predicts" (better on
    the windows that are judged, which no fit has seen), "survives" (still there when any one run is left out).
    fails: whether leaving one out removes it, False with a single run; strength: how much the squared gap rises without
    it, in units of the squared noise floor, at the horizon where that is most; size: its own, in units of the small
    differences in everything else, infinite where there are none; beside: the root of that rise over the largest one of
    another effect, infinite where there is none; standing: the rise that lasts over the squared gap that all named
    effects leave beyond the floor, at the horizon where that is most."""

    evidence: tuple[str, ...]
    strength: float
    size: float = np.inf
    fails: bool = False
    beside: float = np.inf
    standing: float = 0.0


def support_of(
    of: FittedExplanation, longer: Sequence[HorizonWindows], looks: Sequence[HorizonGaps], settings: ResultSettings
) -> dict[Term, Support]:
    """The support of each named effect; looks: the gaps over each horizon, of which `longer` holds the windows."""
    floors = {look.horizon: look.floor.total for look in looks}
    places = [(of.after_data.take(of.test), of.scales)]
    for look in longer:
        if look.horizon in floors:
            places.append(((look.clean if of.with_outliers else look.raw).take(look.test), look.scales))
    left = readjusted(of.problem, of.final)
    rises = [_rises(of, left, data, scales, floors[data.horizon], settings=settings) for data, scales in places]
    runs = of.problem.data.run
    lasts, several = _survives(runs, of.final, settings=settings), len(np.unique(runs)) > 1
    out = {}
    for k, term in enumerate(of.final.terms):
        strength = float(max(r.without[k] for r in rises))
        evidence = ("fits", *(("predicts",) if strength > 0.0 else ()), *(("survives",) if lasts[term] else ()))
        size, fails, beside = _size(of, term, settings=settings), several and not lasts[term], _beside(rises, k)
        standing = float(max(r.lasting[k] / max(r.left, 1.0) for r in rises))
        out[term] = Support(evidence, strength, size, fails, beside, standing)
    return out


def doubts(supports: Mapping[Term, Support], rest: Rest | None, settings: ResultSettings) -> dict[Term, float]:
    """A factor on the probability of each effect: less where it does not help on unseen windows or rests on a single
    run, where it is faint, no larger than small differences elsewhere or than what another effect's law may lack, and
    where what is left depends on a quantity that it would imitate or did so before a law took that up."""
    tuned = settings.support
    named = {term.effect for term in supports}
    on = set() if rest is None else {DEPENDENCE.get(d.kind) for d in rest.depends if d.share >= tuned.depends}
    laws = [BY_NAME[name] for name in named if is_law(name)]
    on |= {DEPENDENCE.get(quantity) for law in laws for quantity in quantities_of(law)}
    out = {}
    for term, support in supports.items():
        helps = 1.0 if "predicts" in support.evidence and not support.fails else tuned.unsupported
        clear = tuned.unsupported + (1.0 - tuned.unsupported) * float(np.clip(support.strength / tuned.clear, 0.0, 1.0))
        large = tuned.unsupported + (1.0 - tuned.unsupported) * float(
            np.clip((support.size - 1.0) / (tuned.large - 1.0), 0.0, 1.0)
        )
        beyond = tuned.unsupported + (1.0 - tuned.unsupported) * float(
            np.clip(support.beside / settings.causes.law - 1.0, 0.0, 1.0)
        )
        imitates = on & BY_NAME[term.effect].imitates
        out[term] = helps * min(clear, large, beyond) * (tuned.unsupported if imitates else 1.0)
    return out


def _size(of: FittedExplanation, term: Term, settings: ResultSettings) -> float:
    """How far an effect's numbers are from doing nothing, over what numbers are off on this robot anyway."""
    tolerances = None if of.tolerated is None else of.tolerated.problem.tolerances
    level = 0.0 if tolerances is None else tolerances.level
    sizes = []
    for knob in of.space.knobs(term):
        p = BY_NAME[term.effect].parameter(knob.parameter)
        if p.shape:
            continue
        usual = max(level * p.tolerance * of.space.reference(knob), _shadow(of.final.values, term))
        if usual == 0.0:
            return np.inf
        sizes.append(abs(of.final.values[knob] - p.null) / usual)
    return max(sizes)


@dataclass(frozen=True, eq=False)
class Rises:
    """By how much the squared gap over one horizon rises, in units of the squared floor: without (T,) each of the
    effects; lasting (T,): likewise, where the others' numbers make up for it as far as they can; with only (T,) each of
    them, and with none. left: the squared gap with all of them beyond the floor, in the same units."""

    without: np.ndarray
    lasting: np.ndarray
    only: np.ndarray
    none: float
    left: float = 0.0


def _beside(horizons: Sequence[Rises], k: int) -> float:
    """How much of the motion effect k predicts beside the largest of the others, or beside all of them together where
    they explain more without it, at the horizon where that is most. An effect that would explain most of the gap by
    itself imitates the others, and what their laws lack looks like it the more: it counts half."""
    shares = []
    for rises in horizons:
        own, others = float(rises.lasting[k]), np.delete(rises.lasting, k)
        most = float(np.maximum(others, 0.0).max(initial=0.0))
        if not len(others) or not (most > 0.0 and np.isfinite([own, most]).all()):
            shares.append(np.inf)  # without an effect a prediction may diverge
            continue
        together = max(most, rises.none - own) if np.isfinite(rises.none) else most
        imitates = rises.none - rises.only[k] > 0.5 * rises.none
        shares.append(float(np.sqrt(max(own, 0.0) / together)) * (0.5 if imitates else 1.0))
    return max(shares)


def _shadow(values: Values, term: Term) -> float:
    """How large the effect may seem by itself beside the named effects on the same target that feign it."""
    most = 0.0
    for quantity, share in BY_NAME[term.effect].shadows:
        for k, v in values.items():
            here = k.effect != TUNE and (k.target == term.target or not k.target)
            if here and BY_NAME[k.effect].parameter(k.parameter).quantity == quantity:
                most = max(most, share * v)
    return most


def _rises(
    of: FittedExplanation,
    left: Mapping[Term, Values],
    data: Dataset,
    scales: Scales,
    floor: float,
    settings: ResultSettings,
) -> Rises:
    """How the squared gap on these windows rises without effects; left: the readjusted values without each of them."""
    terms = of.final.terms
    keep = evenly(data, settings.support.steps, settings=settings.data)
    data = data if keep.all() else data.take(keep)
    none = {k: v for k, v in of.final.values.items() if k.effect == TUNE}
    only = [{**none, **{k: v for k, v in of.final.values.items() if k.term == t}} for t in terms]
    less = [without(of.final.values, t) for t in terms]
    rows = [of.final.values, *less, *(left[t] for t in terms), *only, none]
    errors = [data.y - p for p in predict(data, of.space.settings(rows))]
    trust = fit_trust(data, scales, errors[0], settings=settings.data)
    whole, *more = [gap_of(data, scales, e, trust).total ** 2 for e in errors]
    rises = (np.array(more) - whole) / max(floor**2, 1e-12)
    plain, moved, alone = rises[:-1].reshape(3, len(terms))
    beyond = max(whole - floor**2, 0.0) / max(floor**2, 1e-12)
    return Rises(plain, np.fmin(plain, moved), alone, float(rises[-1]), beyond)


def _survives(run: np.ndarray, final: Fit, settings: ResultSettings) -> dict[Term, bool]:
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
            good &= min(kept) >= settings.support.kept
        out[term] = bool(good)
    return out
