"""An effect in place of the optional numbers of a set.

A search adds one effect at a time and frees the optional numbers of those that it has. A payload that is heavier and
farther from its site than the true one may thus stand for a weak actuator, and nothing tries the actuator later.
"""

from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion, without_the_most_telling
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import distinct, mixed
from residual_mpc.diagnosis.search.optional_numbers import freed, without_numbers
from residual_mpc.diagnosis.search.screen import glance, rankings
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.models.settings import Term, Values


def instead_of_numbers(problem: Problem, fit: Fit, gone: tuple[Term, ...], settings: SearchSettings) -> Fit | None:
    """The set with one more effect, none of those `gone`, and without its optional numbers; None where it has none, or
    no effect with as many numbers at most fits clearly better than these."""
    numbers, tuned = freed(fit.values), settings.rivals
    eligible = tuple(t for t in problem.space.candidates if t not in gone and problem.space.may_join(t, fit.terms))
    if not numbers or not eligible:
        return None
    fit = on_problem(problem, fit, settings=settings.fit)
    (bare,) = fit_all(problem, [without_numbers(fit.values, *numbers)], tuned.wide_steps, settings=settings.fit)
    starts: dict[Term, Values] = {}
    for lead in mixed(*rankings(glance(problem, bare, eligible, settings=settings))):
        starts.setdefault(lead.term, {**bare.values, **lead.start})
    rough = fit_all(
        problem, list(starts.values())[: tuned.looked_at], settings.additions.rough, rough=True, settings=settings.fit
    )
    small = (f for f in distinct(rough) if possible(f.values) and len(f.knobs) <= len(fit.knobs))
    best = sorted(small, key=lambda f: f.cost)[: tuned.best]
    fits = fit_all(problem, [f.values for f in best], settings.steps.thorough_steps, settings=settings.fit)
    blocks = blocks_of(problem.data, settings=settings.fit)
    phi = dispersion(fit, blocks)

    def ratio(other: Fit) -> float:
        less = without_the_most_telling(other.per_window - fit.per_window, blocks)
        return less / phi + tuned.per_knob * (len(other.knobs) - len(fit.knobs))

    found = min((f for f in fits if possible(f.values)), key=ratio, default=None)
    return found if found is not None and ratio(found) < tuned.better else None
