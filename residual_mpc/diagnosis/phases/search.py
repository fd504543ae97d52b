"""The second phase: the set of effects that the headline's horizon shows, what longer horizons add, and its rivals."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from residual_mpc.checkpoint import at_once
from residual_mpc.diagnosis.data.dataset import Dataset, joined
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.data.subsampling import thin_whole
from residual_mpc.diagnosis.fit.least_squares import fit_all, on_problem
from residual_mpc.diagnosis.laws.ripples import RippleFinder
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.closing import closed_anywhere, closed_by_one, extended
from residual_mpc.diagnosis.phases.early_answers import Told, improving, unheard
from residual_mpc.diagnosis.phases.horizons import everywhere, other_horizons, seen_over, worth_searching
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.longer_steps import quickened
from residual_mpc.diagnosis.predict.noise_floor import well_begun
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import build_problem, reweigh, times_longer
from residual_mpc.diagnosis.predict.step_error import made_by_step
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.search.acceptance import build_ruler
from residual_mpc.diagnosis.search.by_target import counted
from residual_mpc.diagnosis.search.instead_of_numbers import instead_of_numbers
from residual_mpc.diagnosis.search.late_partners import with_partner
from residual_mpc.diagnosis.search.optional_numbers import makeup
from residual_mpc.diagnosis.search.other_starts import begun_with, better_everywhere, other_start
from residual_mpc.diagnosis.search.rivals import Rivalry, find_rivals, holds_elsewhere
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Accepted, Found, stepwise_search
from residual_mpc.diagnosis.search.testable import NotTestable, not_testable
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Term, Values

Keep = Callable[[str, Callable[[], Found]], Found]  # a step's name and the step -> its result, maybe of before


@dataclass(frozen=True, eq=False)
class Searched:
    """What the search found: the set, its rivals, what these runs cannot show, and the windows that the last fit is to
    see, all of those that fits may see, with the scales of the longest of them."""

    prepared: Prepared
    found: Found
    rivalry: Rivalry
    untestable: tuple[NotTestable, ...]
    windows: Dataset
    scales: Scales


def search_effects(
    prepared: Prepared,
    rng: np.random.Generator,
    progress: Progress,
    keep: Keep = at_once,
    told: Told = unheard,
    found: Found | None = None,
) -> Searched:
    """Search the headline's horizon, then each longer one for what it adds; then compare with rival explanations.
    found: what the search of the headline's horizon found, if that was done before."""
    progress("searching for effects", 0.05)
    options, settings = prepared.options, prepared.options.settings
    windows, behind = [prepared.headline], 0.42
    if found is None:
        on = partial(search_headline, prepared, rng, lambda text, done: progress(text, searched_share(done)), told)
        found = keep("headline", on)
    first = found
    for look in prepared.longer:
        if look.free is None:
            continue
        data, scales = look.free
        row = prepared.space.settings([found.fit.values])
        data, gap, floor = seen_over(data, scales, found, prepared, rng)
        more = None
        worth = worth_searching(data, gap, floor, options)
        if worth and not made_by_step(data, scales, row, floor.total**2, settings.data):
            behind = 0.56
            progress(f"searching over windows of {data.horizon:g} s", 0.36)
            more = _on(prepared, data, scales, found, rng, lambda text, done: None, improving(told))
        if more is not None and more.steps:
            found, windows = more, [(data, scales)]
        elif gap.total < options.phases.near * floor.total and data.cost <= options.final_steps:
            windows.append((data, scales))  # these sharpen the numbers of the last fit
    progress("comparing with alternative explanations", behind)
    found, rivalry = _finished(prepared, found, (), lambda text: progress(f"{text} again", behind + 0.03))
    by_noise = reweigh(first.problem, first.problem.data.sigma)
    untestable = not_testable(by_noise, first.base, rivalry.fit.terms, settings=settings.search)
    return Searched(prepared, found, rivalry, untestable, joined([d for d, _ in windows]), windows[-1][1])


def search_further(
    searched: Searched, last: FittedExplanation, rng: np.random.Generator, progress: Progress
) -> Searched | None:
    """The search gone on from the last fit where it is not finished; None where it is.

    The search sees few and short windows. On all windows that fits may see, some of its effects may be refuted, so that
    others explain what these stood for, another effect may close most of what is left, or fit better than the optional
    numbers of those that were found.

    Args:
        searched: the search that found the effects.
        last: their last fit, without those that it refuted; these are not added again.
    """
    prepared, found, settings = searched.prepared, searched.found, searched.prepared.options.settings
    if not last.final.terms:
        return None
    more = None
    if last.left_out:
        less = on_problem(found.problem, last.final, settings=settings.fit)
        found = extended(found, less, settings=settings.search)
        more = closed_by_one(found, found.fit, last.left_out, settings)
    if more is None:
        values = _closed_everywhere(searched, last, rng) or _instead_of_numbers(last, settings.search)
        if values is None:
            return None
        (fit,) = fit_all(found.problem, [values], settings=settings.fit)
        more = extended(found, fit, settings=settings.search)
    progress("searching again with all windows", 0.61)
    found, rivalry = _finished(prepared, more, last.left_out, lambda text: progress(f"{text} again", 0.62))
    return replace(searched, found=found, rivalry=rivalry)


def _closed_everywhere(searched: Searched, last: FittedExplanation, rng: np.random.Generator) -> Values | None:
    """The numbers of the last fit with one more effect that closes a good part of what it leaves on all windows that
    fits may see; None where none does, or nothing is left beyond the noise."""
    prepared, options = searched.prepared, searched.prepared.options
    settings = options.settings
    times, sigma = times_longer(searched.found.problem), 1.0 / last.problem.weight
    problem = build_problem(everywhere(prepared), prepared.space, sigma, times=times, settings=settings.predict)
    ruler = build_ruler(problem.replays, prepared.scales, last.base, rng, settings.data)
    if ruler.squared([last.final])[0] <= settings.predict.floor.margin**2 * ruler.floor:
        return None
    final, base = (on_problem(problem, f, settings=settings.fit) for f in (last.final, last.base))
    there = replace(searched.found, problem=problem, fit=final, base=base, ruler=ruler)
    more = closed_by_one(there, final, last.left_out, settings)
    return None if more is None else more.fit.values


def _instead_of_numbers(last: FittedExplanation, settings: SearchSettings) -> Values | None:
    """The last fit with an effect in place of its optional numbers, where that fits clearly better."""
    found = instead_of_numbers(last.problem, last.final, last.left_out, settings)
    return None if found is None else found.values


def _finished(
    prepared: Prepared, found: Found, gone: tuple[Term, ...], report: Callable[[str], None]
) -> tuple[Found, Rivalry]:
    """The result and its rivals, with each effect beside that closes a good part of what is left. gone: effects that
    are not tried."""
    settings, rivalry = prepared.options.settings, _rivals_that_hold(prepared, found)
    late = with_partner(found.problem, found.ruler, rivalry.fit, settings.search)
    if late is not None and counted(late.terms) <= settings.search.largest and all(t not in gone for t in late.terms):
        found = extended(found, late, settings=settings.search)
        rivalry = _rivals_that_hold(prepared, found)
    seen = {makeup(rivalry.fit.values)}  # a rival may drop the addition again
    while (more := closed_anywhere(prepared, found, rivalry.fit, gone)) is not None:
        if makeup(more.fit.values) in seen:
            break
        report("comparing with alternative explanations")
        seen.add(makeup(more.fit.values))
        found, rivalry = more, _rivals_that_hold(prepared, more)
    return found, rivalry


def searched_share(done: float) -> float:
    """The share of a diagnosis that is behind as its first search goes on. done: effects found so far over the most
    that it looks for, 1 where it tests them. This and the other shares are medians of processor time over 20 robots."""
    return min(0.08 + 0.45 * done, 0.28)


def search_headline(prepared: Prepared, rng: np.random.Generator, progress: Progress, told: Told = unheard) -> Found:
    """The search on the windows of the headline's horizon alone, from another start as well where much is left."""
    accepted = improving(told)
    found = _on(prepared, *prepared.headline, None, rng, progress, accepted)
    assert found is not None
    first = other_start(found, prepared.options.settings.search)
    if first is None:
        return found
    begun, renamed, search = rng.spawn(1)[0], _renamed(progress), prepared.options.settings.search
    other = _on(prepared, *prepared.headline, None, begun, renamed, accepted, first, not found.anew)
    return found if other is None else better_everywhere(everywhere(prepared), prepared.scales, found, other, search)


def _renamed(progress: Progress) -> Progress:
    """The progress of a second search, whose share is not counted."""
    return lambda text, _: progress(f"{text}, from another start", 1.0)


def _rivals_that_hold(prepared: Prepared, found: Found) -> Rivalry:
    """The rivals of what was found; of the rival that holds far better on all windows, where there is one."""
    settings, over = prepared.options.settings, other_horizons(prepared, found)
    rivalry = find_rivals(found, over=over, settings=settings.search)
    replays = PredictionCache(everywhere(prepared), prepared.space)
    ruler = replace(found.ruler, scales=prepared.scales)
    better = holds_elsewhere(rivalry, found.met, replays, ruler, settings=settings.search)
    if better is None:
        return rivalry
    exchanged = replace(found, fit=on_problem(found.problem, better, settings=settings.fit))
    return find_rivals(exchanged, most=0, prefer_first=False, over=over, settings=settings.search)


def _budget(robot: Robot, steps: int) -> int:
    """Simulation steps that a hypothesis may cost in the search, `steps` for a robot of six joints or more: a smaller
    one simulates faster, and a servo on the bench has few windows in all. Joints of a closed chain count, whether they
    are measured or not."""
    size = max(len(robot.states), len(optional.joints(robot)))
    return int(steps * np.clip((6.0 / size) ** 2, 1.0, 5.0))


def _on(
    prepared: Prepared,
    windows: Dataset,
    scales: Scales,
    start: Found | None,
    rng: np.random.Generator,
    report: Progress,
    accepted: Accepted,
    first: Term | None = None,
    anew: bool = True,
) -> Found | None:
    """The search on these windows, from what an earlier one found; first: the effect to begin with if nothing was;
    anew: see `stepwise_search`. None where that promises nothing."""
    options, space, settings = prepared.options, prepared.space, prepared.options.settings
    few = thin_whole(windows, _budget(space.robot, options.search_steps), settings=settings.data)
    few = well_begun(few, scales, rng, settings=settings.predict)
    quick = quickened(few, scales, settings=settings.predict)
    own = None if quick is few else few
    problem = build_problem(quick, space, few.sigma, scales.motion, own, settings=settings.predict)
    ripples = RippleFinder(quick, space, scales, settings.remainder, settings.laws.ripples)
    if start is None:
        earlier = _earlier(prepared) if first is None else begun_with(problem, first, settings.search)
        if first is not None and earlier is None:
            return None
        return stepwise_search(
            problem, scales, settings.search, rng, report, earlier, bool(earlier), accepted, ripples, anew
        )
    search = settings.search
    # what helps only together was looked for over the headline's horizon: too dear to ask a physics engine again
    equations = space.robot.step is None
    again = replace(search.pairs, sought=equations and search.pairs.sought)
    longer = replace(search, over_floor=search.over_floor_longer, largest=search.largest_longer, pairs=again)
    start_from = start.fit.values
    return stepwise_search(problem, scales, longer, rng, report, start_from, accepted=accepted, suggest=ripples)


def _earlier(prepared: Prepared) -> Values | None:
    """Those numbers of an earlier explanation that are candidates here; None without any effect among them."""
    space, given = prepared.space, prepared.options.start
    terms = {k.term for k in given if k.effect != TUNE} & set(space.candidates)
    if not terms:
        return None
    tuned = {k: given.get(k, space.null(k)) for k in space.tunables}
    return {**tuned, **{k: v for k, v in given.items() if k.effect != TUNE and k.term in terms}}
