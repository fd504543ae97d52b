"""The account extended on both sets of runs, by model errors that the runs before alone do not show."""

from dataclasses import replace

from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.predict.effect_sets import without
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.search.additions import additions
from residual_mpc.models.settings import Values


def with_common_effects(problem: Problem, values: Values, units: Units, settings: ComparisonSettings) -> Values:
    """The account, with or without changes, and each further effect on both sets that explains more of them than its
    numbers do by chance, less what these make needless.

    The account is searched on the runs before. What their motions do not excite is missing from it or stands under
    another name (behind smooth commands, a dead time acts like viscous friction), and in other motions after the change
    it looks like a change. So does a lag that was mistaken for a delay, once the delay changes.
    """
    tuned, fits, space = settings.account, settings.results.fit, problem.space
    common = tuple(t._replace(changed=False) for t in space.candidates)
    here = replace(problem, space=replace(space, candidates=common))
    search = replace(settings.results.search, shortlist=tuned.shortlist, finalists=tuned.finalists)
    current = first = fit_all(here, [values], settings=fits)[0]
    for _ in range(tuned.further):
        more = [c for c in additions(here, [current], units.number, search) if len(c.terms) > len(current.terms)]
        if not more or not _worth(more[0], current, units, settings):
            break
        current = more[0]
    return values if current is first else _without_needless(here, current, units, settings).values


def _worth(more: Fit, fewer: Fit, units: Units, settings: ComparisonSettings) -> bool:
    """Whether the larger of two fits explains more than its further numbers do by chance."""
    needed = settings.account.worth * (len(more.knobs) - len(fewer.knobs))
    return fewer.cost - more.cost >= needed * dispersion(more, units.number)


def _without_needless(problem: Problem, current: Fit, units: Units, settings: ComparisonSettings) -> Fit:
    """The fit less each effect on both sets that the others make needless."""
    fits, rough = settings.results.fit, settings.search.rough
    while len(common := [t for t in current.terms if not t.changed]) > 1:
        starts = [without(current.values, t) for t in common]
        fewer = fit_all(problem, starts, rough, near=[current] * len(starts), settings=fits)
        least = min(fewer, key=lambda f: f.cost)
        if _worth(current, least, units, settings):
            break
        current = on_problem(problem, least, settings=fits)
    return current
