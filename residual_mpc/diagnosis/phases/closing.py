"""A further effect that closes a good part of the gap that a finished search leaves."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.evidence import blocks_of, dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all, on_problem
from residual_mpc.diagnosis.fit.marginalisation import carrying
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.phases.horizons import is_bearable
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.predict.problem import build_problem, times_longer, tolerating
from residual_mpc.diagnosis.remainder.resemblance import closest
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.search.acceptance import build_ruler, convincing, judge
from residual_mpc.diagnosis.search.by_target import counted
from residual_mpc.diagnosis.search.off_bounds import off_bounds
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.stepwise import Found, Step, prune, refit
from residual_mpc.models.settings import Term


def closed_anywhere(prepared: Prepared, found: Found, current: Fit, gone: tuple[Term, ...]) -> Found | None:
    """As `closed_by_one`: on the windows of the search, and otherwise on longer ones, over which small differences
    between the two sides add up. The noise on these is that of the first look, since the error that a missing effect
    leaves over longer windows looks like drifting noise. The set keeps effects that the longer windows make redundant,
    since the windows of the search are more informative about them."""
    phases, settings = prepared.options.phases, prepared.options.settings
    more = closed_by_one(found, current, gone, settings)
    if more is not None:
        return more
    for data, scales in (look.free for look in prepared.longer if look.free is not None):
        if data.count < phases.blocks or not is_bearable(data, phases):
            continue
        some = data.take(evenly(data, phases.cheap, settings=settings.data))
        times, rng = times_longer(found.problem), np.random.default_rng(0)
        problem = build_problem(some, prepared.space, some.sigma, times=times, settings=settings.predict)
        ruler = build_ruler(problem.replays, scales, found.base, rng, settings.data)
        fit, base = (on_problem(problem, f, settings=settings.fit) for f in (current, found.base))
        there = replace(found, problem=problem, fit=fit, base=base, ruler=ruler)
        longer = closed_by_one(there, fit, gone, settings)
        if longer is not None:
            came = {k: v for k, v in longer.fit.values.items() if k not in current.values}
            (fit,) = fit_all(found.problem, [{**current.values, **came}], settings=settings.fit)
            return extended(found, fit, settings=settings.search)
    return None


def closed_by_one(found: Found, current: Fit, gone: tuple[Term, ...], settings: ResultSettings) -> Found | None:
    """The current set with the effect, none of those `gone`, that closes a good part of the remaining gap, less
    what it makes redundant; None if there is none, or nothing is left beyond the noise and the error of the model's
    own time step. Where little is left, small differences of everything may make it up, and an effect has to close
    most of it by itself. They may also hide an effect from the first look: without them it has to make the gap far
    smaller."""
    search, ruler = settings.search.without_tolerances(), found.ruler
    much = ruler.much_left(current)
    gap = float(ruler.squared([current])[0])
    left = much or gap > settings.predict.floor.margin**2 * ruler.floor
    if not current.terms or counted(current.terms) >= search.largest or not left:
        return None
    if not much and gap - ruler.floor <= ruler.step_error(current):
        return None  # the model's own time step may make that, and this addition needs little evidence
    plain = tolerating(found.problem, None)  # small differences elsewhere may absorb what the effect explains
    near, enough = None, search.sizeable if much else search.most
    far = max(enough, (1.0 - search.rivals.far_smaller) * gap / max(gap - ruler.floor, 1e-12))
    for problem, least in ((found.problem, enough), (plain, far)):
        near = closest(problem, current, gone, ruler, settings.remainder)
        if near is not None and near[1] >= least:
            break
    else:
        return None
    fit, before = fit_all(plain, [near[0].values, current.values], settings=settings.fit)
    blocks = blocks_of(plain.data, settings=settings.fit)
    if not possible(fit.values) or convincing(plain, ruler, before, fit, found.base, blocks, search) is None:
        return None
    fit = off_bounds(plain, fit, search)  # what the new effect makes redundant may have kept its shape from its place
    fit = prune(plain, ruler, fit, found.base, plain.data.sigma, blocks, search)
    return extended(found, fit, settings=settings.search)


def extended(found: Found, fit: Fit, settings: SearchSettings) -> Found:
    """With another set in place of the one that was found, on the weights that it leaves."""
    problem, scales, noise = found.problem, found.ruler.scales, found.problem.data.sigma
    blocks = blocks_of(problem.data, settings=settings.fit)
    here = judge(carrying(problem, fit.values, settings=settings.fit), fit, noise, scales, settings=settings)
    current, base = refit(here, [fit, found.base], settings=settings)
    sigma = 1.0 / judge(problem, current, noise, scales, settings=settings).weight
    steps = (*found.steps, Step(fit.terms, found.fit.cost, current.cost))
    return replace(
        found, problem=here, fit=current, base=base, phi=dispersion(current, blocks), sigma=sigma, steps=steps
    )
