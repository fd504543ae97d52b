"""The whole comparison: cut both sets into windows, account for the robot, look for changes, and judge them."""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.comparison.account import account_of
from residual_mpc.comparison.aside import aside_note, unlike_in_sets, without_unlike
from residual_mpc.comparison.common_effects import with_common_effects
from residual_mpc.comparison.conditions import driven_differently
from residual_mpc.comparison.exchanges import exchanged
from residual_mpc.comparison.named import named_changes, other_candidates, plain
from residual_mpc.comparison.outliers import changed_outliers
from residual_mpc.comparison.prepare import (
    ComparisonInput,
    cut_sets,
    problem_on,
    space_for,
    units_for,
    windows_for,
)
from residual_mpc.comparison.records import Change, ChangeCandidate, ComparedGap, Comparison
from residual_mpc.comparison.rivals import find_change_rivals
from residual_mpc.comparison.search import FoundChanges, leading_change, search_changes
from residual_mpc.comparison.sets import TwoSets
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.settled import Searched, Settled, settle
from residual_mpc.comparison.sizes import changed_numbers, least_half
from residual_mpc.comparison.space import ChangeSpace
from residual_mpc.comparison.suspect import suspect_note
from residual_mpc.comparison.thresholds import spread_of
from residual_mpc.comparison.units import Units
from residual_mpc.comparison.verdict import unexplained_share, verdict_of, worth_naming
from residual_mpc.comparison.visible import smallest_visible
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.least_squares import on_problem
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
        found = _compared(given, settings, rng, progress)
        space = found.settled.problem.space
        assert isinstance(space, ChangeSpace)
        whole = _judged(given, found, settings)
        if whole.verdict not in ("unknown", "partial"):
            return whole  # nothing is left that a stretch would have to account for
        unlike = unlike_in_sets(found.sets, space, found.settled.fit.values, settings.results.aside)
        if not unlike.stretches:
            return whole
        progress("comparing again without what is unlike the rest", 0.05)
        whole = _judged(given, _compared(without_unlike(given, unlike), settings, rng, progress), settings)
        return replace(whole, notes=(*whole.notes, *aside_note(unlike, given.options.horizon)))


@dataclass(frozen=True, eq=False)
class Compared:
    """searches: of the changes, and on all windows; jumping: the change of the share of outliers."""

    sets: TwoSets
    settled: Settled
    searches: tuple[Searched, Searched]
    jumping: tuple[Change, ...]


def _compared(
    given: ComparisonInput, settings: ComparisonSettings, rng: np.random.Generator, progress: Progress
) -> Compared:
    """Everything but the judgement."""
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
        searched = Searched(_searched(problem, account, units, settings, start), problem, units)
    assert searched is not None
    whole = _on_all_windows(given, sets, windows[0], account, searched, settings)
    if whole.found.changes != searched.found.changes:
        searched = searched.with_changes_of(whole.found, settings)
    progress("comparing with alternative changes", 0.7)
    rivals = find_change_rivals(searched.problem, searched.found, searched.units, settings)
    progress("fitting on all windows", 0.8)
    jumping = _outliers(given, sets, settings)
    settled = settle(given, sets, windows[0], whole, rivals, bool(jumping), rng, settings)
    return Compared(sets, settled, (searched, whole), jumping)


def _searched(
    problem: Problem, account: Values, units: Units, settings: ComparisonSettings, start: FoundChanges | None
) -> FoundChanges:
    """Search for changes one by one, exchange pairs, and search for further changes beside those; repeat all of it if
    both sets show further effects beside the changes."""
    found = _with_exchanges(problem, account, units, settings, start)
    if not found.changes or start is not None:
        return found
    more = with_common_effects(problem, found.fit.values, units, settings)
    if more.keys() == found.fit.values.keys():
        return found
    fuller = {k: v for k, v in more.items() if not k.changed}
    return _with_exchanges(problem, fuller, units, settings, None)


def _with_exchanges(
    problem: Problem, account: Values, units: Units, settings: ComparisonSettings, start: FoundChanges | None
) -> FoundChanges:
    found = search_changes(problem, account, units, settings, start)
    better = exchanged(problem, found, units, settings)
    return found if better is found else search_changes(problem, account, units, settings, better)


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


def _judged(given: ComparisonInput, compared: Compared, settings: ComparisonSettings) -> Comparison:
    """The verdict and the whole answer."""
    sets, settled, jumping = compared.sets, compared.settled, compared.jumping
    searched, last = compared.searches
    whole, units, fit, left = settled.problem, settled.units, settled.fit, settled.left
    rivals, gap, space, fits = settled.rivals, settled.gap, settled.problem.space, settings.results.fit
    assert isinstance(space, ChangeSpace)
    found, spread = rivals.found, spread_of(whole, fit, units)
    unexplained = unexplained_share(gap, settings)
    lost = last.found.again is not None
    verdict = verdict_of(bool(found.changes or jumping), left.p, unexplained, gap, lost, settings)
    named = named_changes(whole, fit, rivals, spread, gap.predicted, settings.sure, settings)
    sure = settings.sure if verdict == "changed" else settings.sure_partial * (1.0 - unexplained)
    if sure != settings.sure:
        named = named_changes(whole, fit, rivals, spread, gap.predicted, sure, settings)
    considered = (*named, *jumping)
    groups = tuple(tuple(tuple(plain(t) for t in m) for m in g) for g in rivals.groups)
    # what is not named was significant, so that the sets differ
    unnamed = verdict_of(False, 0.0, unexplained, gap, lost, settings)
    changes, verdict = worth_naming(considered, jumping, verdict, unnamed, sure, settings)
    groups = groups if changes == considered else ()
    gap = gap if changes else gap.of_no_change
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
