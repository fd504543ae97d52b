"""The changes that stay after the last fits: those that have a size, and that predict windows that no fit has seen."""

from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.comparison.contrast import Contrasts
from residual_mpc.comparison.gaps import compared_gap
from residual_mpc.comparison.leads import without_change
from residual_mpc.comparison.named import may_be_none
from residual_mpc.comparison.prepare import ComparisonInput, problem_on, units_for
from residual_mpc.comparison.records import ComparedGap
from residual_mpc.comparison.rivals import ChangeRivals
from residual_mpc.comparison.search import FoundChanges, told_apart
from residual_mpc.comparison.sets import TwoSets
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.sizes import Spread, came_to_nothing, to_the_end
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.comparison.thresholds import spread_of
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.models.settings import Term


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search found, on which windows and stretches."""

    found: FoundChanges
    problem: Problem
    units: Units

    def with_changes_of(self, other: FoundChanges, settings: ComparisonSettings) -> "Searched":
        """The changes that another search found, fitted on these windows: the rivals need no more of them."""
        fit = fit_all(self.problem, [other.fit.values], 6, settings=settings.results.fit)[0]
        phi = dispersion(fit, self.units.number)
        return replace(self, found=FoundChanges(fit, self.found.account, other.changes, other.left, phi))


@dataclass(frozen=True, eq=False)
class Settled:
    """The changes that stay (of `rivals.found`), fitted on all windows; left: how the sets still differ; gap: of models
    whose fits have not seen it."""

    problem: Problem
    units: Units
    fit: Fit
    left: Contrasts
    rivals: ChangeRivals
    gap: ComparedGap


def settle(
    given: ComparisonInput,
    sets: TwoSets,
    windows: tuple[Dataset, Scales],
    last: Searched,
    rivals: ChangeRivals,
    jumping: bool,
    rng: np.random.Generator,
    settings: ComparisonSettings,
) -> Settled:
    """The changes fitted to the end on all windows. Dropped are, in turn, those whose numbers came to nothing, faint or
    insignificant ones that may have no size, and those without which unseen windows fit as well: a difference between
    two sets of which the change predicts nothing has another cause. last: the search on all windows; jumping: whether
    outliers changed."""
    space = last.problem.space
    assert isinstance(space, ChangeSpace)
    problem, units, fit, left = _fitted(given, sets, windows, space, last, rivals.found, settings)
    moved = tuple(c for c in rivals.found.changes if not came_to_nothing(fit, space, c.term))
    if moved != rivals.found.changes:
        kept = {k: v for k, v in fit.values.items() if not k.changed or k.term in {c.term for c in moved}}
        fit = to_the_end(problem, fit_all(problem, [kept], settings=settings.results.fit)[0], settings.results)
    rivals = rivals.of(replace(rivals.found, changes=moved))
    while True:
        gone = _least_without_size(problem, fit, rivals, spread_of(problem, fit, units), settings)
        if gone is None:
            gap = compared_gap(sets, problem, fit, jumping, rng, settings)
            gone = _predicting_nothing(gap, rivals, settings)
        if gone is None:
            return Settled(problem, units, fit, left, rivals, gap)
        (fit,) = fit_all(problem, [without_change(fit.values, gone)], settings=settings.results.fit)
        fit = to_the_end(problem, fit, settings.results)
        rivals = rivals.of(replace(rivals.found, changes=tuple(c for c in rivals.found.changes if c.term != gone)))
        left = told_apart(problem, fit, units, settings)


def _fitted(
    given: ComparisonInput,
    sets: TwoSets,
    windows: tuple[Dataset, Scales],
    space: ChangeSpace,
    last: Searched,
    found: FoundChanges,
    settings: ComparisonSettings,
) -> tuple[Problem, Units, Fit, Contrasts]:
    """The changes on the model's own steps; where there are none, what the last search ended with."""
    if not found.changes:
        return last.problem, last.units, last.found.fit, last.found.left
    problem = problem_on(*windows, space, found.fit.values, settings.search.final_steps, settings)
    units = units_for(problem.data, sets, given, settings)
    fit = to_the_end(problem, found.fit, settings.results)
    same = all(np.array_equal(getattr(problem.data, x), getattr(last.problem.data, x)) for x in ("run", "start"))
    as_tested = same and found.changes == last.found.changes
    return problem, units, fit, last.found.left if as_tested else told_apart(problem, fit, units, settings)


def _least_without_size(
    problem: Problem, fit: Fit, rivals: ChangeRivals, spread: Spread, settings: ComparisonSettings
) -> Term | None:
    """Of the changes that may have no size, the one that explains least: another one may have one without it."""
    none = [c.term for c in rivals.found.changes if may_be_none(problem, fit, c, rivals, spread, settings)]
    return min(none, key=lambda t: rivals.parts.get(t, 1.0), default=None)


def _predicting_nothing(gap: ComparedGap, rivals: ChangeRivals, settings: ComparisonSettings) -> Term | None:
    """The change that predicts least, if the windows that its numbers were not fitted to fit no better with it. One
    that is significant by its fit alone has to predict more than the standard error of what it predicts."""
    insignificant = {c.term for c in rivals.found.changes if c.p > settings.contrast.level}
    gains = {t: p.gain - (p.error if t in insignificant else 0.0) for t, p in gap.predicted.items()}
    least = min(gains, key=lambda t: gains[t], default=None)
    return least if least is not None and gains[least] <= 0.0 else None
