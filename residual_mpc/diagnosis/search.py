"""Which set of effects: forward by the best addition, back by pruning, across by swapping, until nothing changes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit import Fit, fit_all, on_problem
from residual_mpc.diagnosis.problem import Problem, build_problem, reweigh
from residual_mpc.diagnosis.screen import screen
from residual_mpc.models.settings import TUNE, Knob, Term, Values


@dataclass(frozen=True)
class SearchSettings:
    """How hard to look, and what counts as found.

    beyond_doubt: likelihood ratio (drop in cost over dispersion) per added term, on top of `per_knob` for each knob;
    worth: an addition has to remove this share of what is left, or `worth_first` of the first model's excess;
    shortlist: starts that are fitted per step; largest: terms in a set.
    """

    beyond_doubt: float = 25.0
    per_knob: float = 4.0
    worth: float = 0.35
    worth_first: float = 0.03
    shortlist: int = 10
    largest: int = 5


@dataclass(frozen=True)
class Step:
    """One accepted step of the search, for the report: the set after it, and its cost in that step's weights."""

    terms: tuple[Term, ...]
    before: float
    after: float


@dataclass(frozen=True)
class Found:
    """The chosen set on its final weights, its sub- and rival sets on the same weights, and the way there."""

    problem: Problem
    fit: Fit
    base: Fit
    phi: float
    steps: tuple[Step, ...]


Report = Callable[[str], None]


def search(problem: Problem, settings: SearchSettings, report: Report = lambda _: None) -> Found:
    """Search on the problem's windows. The problem's own weights are those of the pure sensor noise."""
    noise = 1.0 / problem.weight
    blocks = blocks_of(problem.data)
    base_values: Values = {k: problem.space.null(k) for k in problem.space.tunables}
    base = fit_all(problem, [base_values])[0]
    current, steps = base, list[Step]()
    while len(current.terms) < settings.largest:
        here = judge(problem, current, noise)
        current = refit(here, [current])[0]
        report(f"{len(current.terms)} effects named; looking for the next")
        best = best_addition(here, current, settings)
        if best is None or not convincing(problem, here, current, best, base, blocks, settings):
            break
        steps.append(Step(best.terms, current.cost, best.cost))
        current = best
        current = prune(problem, current, base, noise, blocks, settings)
    here = judge(problem, current, noise)
    current, base = refit(here, [current, base])
    return Found(here, current, base, dispersion(current, blocks), tuple(steps))


def judge(problem: Problem, fit: Fit, noise: np.ndarray) -> Problem:
    """The problem with each channel weighed by what this fit leaves of it, never less than its noise."""
    plain = reweigh(problem.data, problem.space, problem.sensitivity, noise)
    r = plain.residuals([fit.values])[0].reshape(*problem.data.y.shape)
    seen = np.isfinite(problem.data.y)
    left = np.sqrt(np.sum(r * r, axis=(0, 1)) / np.maximum(seen.sum(axis=(0, 1)), 1))
    return reweigh(problem.data, problem.space, problem.sensitivity, noise * np.maximum(left, 1.0))


def refit(problem: Problem, fits: list[Fit], most: int = 6) -> list[Fit]:
    """The same sets fitted on this problem, from where they were."""
    return fit_all(problem, [f.values for f in fits], most)


def compatible(term: Term, terms: tuple[Term, ...]) -> bool:
    """Whether a term may join: not twice the same, and never an effect both on all targets and on one."""
    return all(t.effect != term.effect or (t.target is not None and term.target is not None and t != term) for t in terms)


def best_addition(problem: Problem, current: Fit, settings: SearchSettings) -> Fit | None:
    """The best fit with one more term; None where no candidate is left."""
    candidates = tuple(c for c in problem.space.candidates if compatible(c, current.terms))
    leads = screen(problem, current, candidates)[: settings.shortlist]
    fits = fit_all(problem, [{**current.values, **lead.start} for lead in leads])
    return min(fits, key=lambda f: f.cost, default=None)


def convincing(
    problem: Problem,
    here: Problem,
    current: Fit,
    best: Fit,
    base: Fit,
    blocks: np.ndarray,
    settings: SearchSettings,
) -> bool:
    """Beyond doubt against coloured residuals, and worth naming."""
    fair = judge(here, best, 1.0 / problem.weight)
    after, before, first = on_problem(fair, best), on_problem(fair, current), on_problem(fair, base)
    phi = dispersion(after, blocks)
    gain = before.cost - after.cost
    knobs = len(after.knobs) - len(before.knobs)
    floor = float(np.count_nonzero(after.r))  # the cost of pure noise, where the weights are the noise's
    left, all_of_it = max(before.cost - floor, 1e-9), max(first.cost - floor, 1e-9)
    worth = gain > settings.worth * left or gain > settings.worth_first * all_of_it
    return gain / phi > settings.beyond_doubt + settings.per_knob * knobs and worth


def prune(
    problem: Problem, current: Fit, base: Fit, noise: np.ndarray, blocks: np.ndarray, settings: SearchSettings
) -> Fit:
    """Drop terms that the others have made needless."""
    while len(current.terms) > 1:
        here = judge(problem, current, noise)
        full = refit(here, [current])[0]
        fewer = fit_all(here, [without(full.values, t) for t in full.terms])
        weakest = min(fewer, key=lambda f: f.cost)
        if convincing(problem, here, weakest, full, base, blocks, settings):
            return full
        current = weakest
    return current


def without(values: Values, term: Term) -> dict[Knob, float]:
    """The values less one term's."""
    return {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}
