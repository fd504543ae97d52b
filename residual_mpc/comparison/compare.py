"""The whole comparison: cut both sets into windows, account for the robot, look for changes, and judge them."""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.comparison.account import account_of
from residual_mpc.comparison.common_effects import with_common_effects
from residual_mpc.comparison.conditions import driven_differently
from residual_mpc.comparison.gaps import compared_gap
from residual_mpc.comparison.named import may_be_none, named_changes, other_candidates, plain
from residual_mpc.comparison.outliers import changed_outliers
from residual_mpc.comparison.prepare import (
    ComparisonInput,
    cut_sets,
    problem_on,
    space_for,
    units_for,
    windows_for,
)
from residual_mpc.comparison.records import Change, ChangeCandidate, ComparedGap, Comparison, GapRise
from residual_mpc.comparison.rivals import ChangeRivals, find_change_rivals
from residual_mpc.comparison.search import FoundChanges, leading_change, search_changes, told_apart
from residual_mpc.comparison.sets import TwoSets
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.sizes import came_to_nothing, changed_numbers, least_half, to_the_end
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.comparison.suspect import suspect_note
from residual_mpc.comparison.thresholds import spread_of
from residual_mpc.comparison.units import Units
from residual_mpc.comparison.visible import smallest_visible
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import fit_all, on_problem
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.diagnosis.predict.problem import Problem, reweigh
from residual_mpc.diagnosis.results.next_experiment import next_experiment
from residual_mpc.diagnosis.search.testable import not_testable
from residual_mpc.effects.sensor import SENSOR_OUTLIERS
from residual_mpc.models.settings import Values


def compare(
    given: ComparisonInput,
    settings: ComparisonSettings,
    rng: np.random.Generator,
    progress: Progress = lambda stage, done: None,
) -> Comparison:
    """Name what differs between two sets of runs.

    Raises BadInput where one of the sets cannot be compared.
    """
    with threadpool_limits(1, "blas"):
        progress("splitting the runs into windows", 0.02)
        sets = cut_sets(given, settings)
        progress("accounting for the robot", 0.05)
        account = account_of(
            given.before, given.robots[: len(given.before)], given.noise, given.tunable, given.options,
            settings.account, rng, lambda stage, done: progress(stage, 0.05 + 0.45 * done),
        )  # fmt: skip
        space = space_for(given, sets)
        progress("searching for changes", 0.5)
        searched = None
        windows = windows_for(given, sets, rng, settings)
        for data, scales in windows:
            values = account if searched is None else searched.found.fit.values
            exact = problem_on(data, scales, space, values, settings.search.steps, settings)
            problem = on_longer_steps(exact, scales, values, settings=settings.results.predict)
            units = units_for(problem.data, sets, given, settings)
            start = None if searched is None else searched.found
            if start is None:
                account = with_common_effects(problem, account, units, settings)
            searched = Searched(search_changes(problem, account, units, settings, start), problem, units)
        assert searched is not None
        whole = _on_all_windows(given, sets, windows[0], account, searched, settings)
        if whole.found.changes != searched.found.changes:
            searched = searched.with_changes_of(whole.found, settings)
        progress("comparing with alternative changes", 0.7)
        rivals = find_change_rivals(searched.problem, searched.found, searched.units, settings)
        progress("fitting on all windows", 0.8)
        return _judged(given, sets, windows[0], space, (searched, whole), rivals, rng, settings)


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


def _on_all_windows(
    given: ComparisonInput,
    sets: TwoSets,
    windows: tuple[Dataset, Scales],
    account: Values,
    searched: Searched,
    settings: ComparisonSettings,
) -> Searched:
    """What the search finds when it goes on with all windows: it has seen some of them, and the verdict is about
    all."""
    found, space = searched.found, searched.problem.space
    if len(found.changes) >= settings.search.most:
        return searched
    assert isinstance(space, ChangeSpace)
    exact = problem_on(*windows, space, found.fit.values, settings.search.final_steps, settings)
    if exact.data.count <= searched.problem.data.count:
        return searched
    whole = on_longer_steps(exact, windows[1], found.fit.values, settings=settings.results.predict)
    units = units_for(whole.data, sets, given, settings)
    choice = (searched.problem, searched.units)
    return Searched(search_changes(whole, account, units, settings, found, choice), whole, units)


def _judged(
    given: ComparisonInput,
    sets: TwoSets,
    windows: tuple[Dataset, Scales],
    space: ChangeSpace,
    searches: tuple[Searched, Searched],
    rivals: ChangeRivals,
    rng: np.random.Generator,
    settings: ComparisonSettings,
) -> Comparison:
    """Sizes on all windows, gaps by cross-validation, and the verdict. searches: of the changes, and on all windows."""
    found, fits = rivals.found, settings.results.fit
    searched, last = searches
    if found.changes:
        whole = problem_on(*windows, space, found.fit.values, settings.search.final_steps, settings)
        units = units_for(whole.data, sets, given, settings)
        fit = to_the_end(whole, found.fit, settings.results)
        same = all(np.array_equal(getattr(whole.data, x), getattr(last.problem.data, x)) for x in ("run", "start"))
        as_tested = same and found.changes == last.found.changes
        left = last.found.left if as_tested else told_apart(whole, fit, units, settings)
    else:
        whole, units, fit, left = last.problem, last.units, last.found.fit, last.found.left
    moved = tuple(c for c in found.changes if not came_to_nothing(fit, space, c.term))
    spread = spread_of(whole, fit, units)
    seen = tuple(c for c in moved if not may_be_none(whole, fit, c.term, rivals, spread, settings))
    if seen != moved:
        kept = {k: v for k, v in fit.values.items() if not k.changed or k.term in {c.term for c in seen}}
        fit = to_the_end(whole, fit_all(whole, [kept], settings=fits)[0], settings.results)
        spread = spread_of(whole, fit, units)
    found = replace(found, changes=seen)
    rivals = rivals.of(found)
    jumping = _outliers(given, sets, settings)
    gap = compared_gap(sets, whole, fit, bool(jumping), rng, settings)
    unexplained = _unexplained(gap.rise)
    rises = last.found.again is not None and gap.after > settings.rises * max(gap.before, gap.noise_floor)
    verdict = _verdict(bool(found.changes or jumping), left.p, unexplained, gap.rise, rises, settings)
    named = named_changes(whole, fit, rivals, spread, settings.sure, settings)
    sure = settings.sure if verdict == "changed" else settings.sure_partial * (1.0 - unexplained)
    named = named if sure == settings.sure else named_changes(whole, fit, rivals, spread, sure, settings)
    considered = (*named, *jumping)
    groups = tuple(tuple(tuple(plain(t) for t in m) for m in g) for g in rivals.groups)
    # what is not named was significant, so that the sets differ
    unnamed = _verdict(False, 0.0, unexplained, gap.rise, rises, settings)
    changes, verdict = _worth_naming(considered, jumping, verdict, unnamed, sure, settings)
    groups = groups if changes == considered else ()
    by_noise = reweigh(searched.problem, searched.problem.data.sigma)
    base = on_problem(by_noise, found.account, settings=fits)
    unseen = not_testable(by_noise, base, tuple(c.term for c in found.changes), settings=settings.results.search)
    return Comparison(
        robot=space.robot.name,
        verdict=verdict,
        changes=changes,
        groups=groups,
        candidates=(
            *(ChangeCandidate(c.term, c.probability, c.p) for c in considered),
            *other_candidates(rivals, sure),
        ),
        gap=gap,
        unexplained={"same": 0.0, "unknown": 1.0}.get(verdict, unexplained),
        not_testable=tuple(replace(n, term=plain(n.term)) for n in unseen),
        account=tuple(t for t in found.account.terms if not t.changed),
        units=(int((~units.later).sum()), int(units.later.sum())),
        visible=tuple(
            replace(v, term=plain(v.term)) for v in smallest_visible(space, left.told, settings.contrast.level)
        ),
        p_left=left.p,
        values=fit.values,
        next_experiment=next_experiment(
            groups, wheeled="left" in space.robot.actuators, verdict="partial" if groups else "no_gap"
        ),
        notes=(
            *(_leading(last, settings) if verdict == "unknown" else ()),
            *(suspect_note(space, left.told, settings.suspected) if verdict == "same" else ()),
            *_driving(sets, gap, verdict, settings),
        ),
    )


def _leading(last: Searched, settings: ComparisonSettings) -> tuple[str, ...]:
    """A note on the change that would explain most where none is significant."""
    again = last.found.again
    lead = None if again is None else leading_change(last.problem, again, settings)
    if lead is None:
        return ()
    term, spread = lead.lead.term, spread_of(last.problem, lead.fit, last.units)
    half = least_half(last.problem, lead.fit, term, settings)
    numbers = changed_numbers(last.problem, lead.fit, term, spread, half)
    sizes = ", ".join(f"{n.name} {n.change:.3g} {n.unit}".removesuffix(" 1") for n in numbers)
    share = lead.drop / lead.common.cost
    return (
        f"Of single changes, {plain(term)} would remove most of the squared error, {share:.0%} ({sizes}), but between "
        "these runs it is not significant",
    )


def _driving(sets: TwoSets, gap: ComparedGap, verdict: str, settings: ComparisonSettings) -> tuple[str, ...]:
    """A note on sets that are driven differently, where that may be why they differ."""
    how = driven_differently(sets.clean, sets.side(sets.clean), settings.unlike)
    worse = gap.after_explained > settings.worse * max(gap.before, gap.noise_floor)
    if not how or (verdict in ("same", "changed") and not worse):
        return ()
    return (
        f"The runs after are driven differently: their commands {how}. What the model gets wrong in such motions alone "
        "looks like a change, so repeat the motions of the runs before",
    )


def _outliers(given: ComparisonInput, sets: TwoSets, settings: ComparisonSettings) -> tuple[Change, ...]:
    """The change of the share of outliers, where there is one that may be named."""
    only, without = given.options.only, given.options.without
    if (only and SENSOR_OUTLIERS.name not in only) or SENSOR_OUTLIERS.name in without:
        return ()
    change = changed_outliers(sets, settings.sure, settings.contrast)
    return () if change is None else (change,)


def _verdict(
    named: bool, p_left: float, unexplained: float, rise: GapRise, rises: bool, settings: ComparisonSettings
) -> str:
    """`same`: nothing beyond what units of one set differ, or no rise of the gap by that, nor a gap that is several
    times as large after (rises); `changed`: nothing beyond that is left, nor much of the rise of the gap."""
    differs = p_left <= settings.contrast.left
    if not named:
        return "unknown" if rises or (differs and rise.visible) else "same"
    return "partial" if differs or unexplained > settings.unexplained else "changed"


def _worth_naming(
    considered: tuple[Change, ...], jumping: tuple[Change, ...], verdict: str, without: str, sure: float,
    settings: ComparisonSettings,
) -> tuple[tuple[Change, ...], str]:  # fmt: skip
    """The changes to name and the verdict. Changes that explain next to nothing of the rise are not named; outliers
    are counted, not explained, and stay. without: the verdict where nothing is named; sure: the largest probability
    that a change may have."""
    if not considered or sure >= settings.named:
        return considered, verdict
    return jumping, verdict if jumping else without


def _unexplained(rise: GapRise) -> float:
    """Share of the rise that the changes leave; 0 where what is left is within two standard errors, unless it is more
    than half of a rise that is beyond two."""
    if not rise.risen > 0.0 or rise.left <= 0.0:
        return 0.0
    share = min(rise.left / rise.risen, 1.0)
    beyond = rise.left > 2.0 * rise.left_error
    return share if beyond or (share > 0.5 and rise.visible) else 0.0
