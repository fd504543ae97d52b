"""Changes that may be added to a fit, each fitted with everything else."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from residual_mpc.comparison.contrast import Contrast
from residual_mpc.comparison.likelihood import Explanation
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, possible
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import varied
from residual_mpc.effects.effect import Parameter
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term, Values

FARTHEST = 5.0  # largest absolute logarithm of a factor's starting value


@dataclass(frozen=True, eq=False)
class FittedLead:
    """A lead, fitted with everything else; common: the same with the effect on both sets alike in place of the change,
    or without it where that fits better: the model's own error in the effect speaks for no change."""

    lead: Contrast
    fit: Fit
    common: Fit

    @property
    def drop(self) -> float:
        """By which the change alone lowers the cost."""
        return self.common.cost - self.fit.cost

    @property
    def explanation(self) -> Explanation:
        """What the change alone explains."""
        return Explanation(self.lead.term, self.fit, self.common.per_window - self.fit.per_window)


def with_change(problem: Problem, values: Values, lead: Contrast) -> Values:
    """Where the fit of a lead begins: its probe, scaled as the units tell, as a change and, where doing nothing is a
    number, on both sets, so that the model's own error in it is none of the change."""
    out = {**values, **scaled_probe(problem, lead.probe, lead.dose)}
    both = not any(BY_NAME[k.effect].parameter(k.parameter).shape for k in lead.probe)
    for knob, value in lead.probe.items():
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        own = knob._replace(changed=False)
        if both and np.isfinite(p.null) and not {own, own._replace(target=None)} & values.keys():
            out[own] = _within(problem, own, _times(p.null, value, lead.before) if _is_scaled(p) else p.null)
    return out


def scaled_probe(problem: Problem, probe: Values, dose: float) -> Values:
    """A probe of a change, with its distance from the null value multiplied by `dose` where it has one."""
    out = {}
    for knob, value in probe.items():
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        out[knob] = _within(problem, knob, _times(p.null, value, dose) if _is_scaled(p) else value)
    return out


def _is_scaled(p: Parameter) -> bool:
    """Whether a parameter of an effect scales with its dose."""
    return not p.shape and bool(np.isfinite(p.null)) and not p.threshold


def _times(null: float, value: float, dose: float) -> float:
    """The start of a fit: the null plus `dose` times the distance of the value from it. Factors are extrapolated on a
    logarithmic scale: a linear extrapolation may become negative, and a fit that starts at a bound can stay there."""
    if null == 1.0 and value > 0.0:
        return float(np.exp(np.clip(dose * np.log(value), -FARTHEST, FARTHEST)))
    return null + dose * (value - null)


def _within(problem: Problem, knob: Knob, value: float) -> float:
    return float(np.clip(value, *problem.space.bounds(knob)))


def changed_terms(fit: Fit) -> tuple[Term, ...]:
    """The changes in a fit."""
    return tuple(t for t in fit.terms if t.changed)


def without_change(values: Values, term: Term) -> Values:
    """The values without a change; what acts on both sets stays."""
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}


def _on_both_alike(values: Values, term: Term) -> dict[Knob, float]:
    """The values without a change, where both sets have none of the effect with it on both."""
    out = dict(without_change(values, term))
    for knob in (k for k in values if k.effect != TUNE and k.term == term):
        own = knob._replace(changed=False)
        if own not in out and own._replace(target=None) not in out:
            out[own] = values[knob]
    return out


def fitted_leads(
    problem: Problem, current: Fit, leads: list[Contrast], settings: ComparisonSettings, also: Sequence[Values] = ()
) -> list[FittedLead]:
    """The first few leads fitted with everything else, the change that lowers the cost most first, each term once.
    also: other values of what acts on both sets, from which the first of them are fitted as well."""
    tuned, fits = settings.search, settings.results.fit
    chosen = varied(leads, settings=settings.results.search)[: tuned.shortlist]
    pairs = [(c, current.values) for c in chosen] + [(c, b) for b in also for c in chosen[: tuned.finalists]]
    chosen = [c for c, _ in pairs]
    starts = [with_change(problem, base, c) for c, base in pairs]
    new = [frozenset(s).difference(current.knobs) for s in starts]
    near = [current] * len(starts)
    rough = fit_all(problem, starts, tuned.rough, rough=True, near=near, fresh=new, settings=fits)
    order = sorted(range(len(rough)), key=lambda i: rough[i].cost)
    seen: dict[Term, int] = {}
    for i in order:
        seen.setdefault(chosen[i].term, i)
    finalists = list(seen.values())[: tuned.finalists]
    ends = fit_all(problem, [rough[i].values for i in finalists], fresh=[new[i] for i in finalists], settings=fits)
    found = [(chosen[i], f) for i, f in zip(finalists, ends, strict=True) if possible(f.values)]
    out = _beside_both_alike(problem, current, found, settings)
    return sorted(out, key=lambda one: -one.drop)


def _beside_both_alike(
    problem: Problem, current: Fit, pairs: Sequence[tuple[Contrast, Fit]], settings: ComparisonSettings
) -> list[FittedLead]:
    """Each fitted lead with the fit that it is measured against."""
    alike = [_on_both_alike(fit.values, lead.term) for lead, fit in pairs]
    more = [i for i, values in enumerate(alike) if values.keys() - current.values.keys()]
    fitted = fit_all(
        problem,
        [alike[i] for i in more],
        near=[pairs[i][1] for i in more],
        fresh=[frozenset(alike[i].keys() - pairs[i][1].values.keys()) for i in more],
        settings=settings.results.fit,
    )
    common = {i: min(current, fit, key=lambda f: f.cost) for i, fit in zip(more, fitted, strict=True)}
    return [FittedLead(lead, fit, common.get(i, current)) for i, (lead, fit) in enumerate(pairs)]


def p_of_fit(one: FittedLead, phi: float, units: Units, hypotheses: int) -> float:
    """Probability that the best of so many changes lowers the cost as much by chance, by the F test of its numbers with
    the runs as observations; phi: dispersion by unit. The contrasts are linear in a probe; a change that every probe
    describes badly (a spring whose rest is elsewhere) may explain everything, and yet its contrast may not survive the
    correction for many hypotheses."""
    numbers = sum(k.changed and k.term == one.lead.term for k in one.fit.knobs)
    freedom = len(np.unique(units.run)) - 2
    if freedom < 1 or not numbers:
        return 1.0
    return min(1.0, hypotheses * float(fdtrc(numbers, freedom, max(one.drop, 0.0) / phi / numbers)))
