"""Numbers that stay at their null value unless the runs show another, such as where a payload sits beside its site.

No probe looks at them, and a set is searched without them. Once the effect that they belong to is in a set, one
derivative each says by how much freeing them would lower the cost (a score test: Rao, Linear Statistical Inference,
1973, section 6e.3), for every choice among them; what may pass for beyond doubt is fitted, and has to be convincing
like an effect that is added.
"""

from collections.abc import Sequence
from itertools import chain, combinations

import numpy as np
from scipy.special import chdtri

from residual_mpc.diagnosis.fit.evidence import T95, covariance
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.search.screen import absorbed
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term, Values

AT_BOUND = 0.01  # of the range between the bounds, within which a number counts as at one
Makeup = frozenset[Term | Knob]  # the effects of a set, and which of their optional numbers are free


def freed(values: Values) -> tuple[Knob, ...]:
    """The optional numbers among the values."""
    return tuple(k for k in values if k.effect != TUNE and BY_NAME[k.effect].parameter(k.parameter).optional)


def makeup(values: Values) -> Makeup:
    """What two sets have to share to be the same."""
    return frozenset(k.term for k in values if k.effect != TUNE) | frozenset(freed(values))


def without_numbers(values: Values, *knobs: Knob) -> dict[Knob, float]:
    """The values with some optional numbers at their null values."""
    return {k: v for k, v in values.items() if k not in knobs}


def with_all_free(space: Space, values: Values) -> dict[Knob, float]:
    """The values, and the other optional numbers of the effects of which one is free, at their null values."""
    every = [k for term in dict.fromkeys(k.term for k in freed(values)) for k in space.optional(term)]
    return {**dict(values), **{k: space.null(k) for k in every if k not in values}}


def may_be_shown(problem: Problem, fit: Fit) -> tuple[Knob, ...]:
    """The optional numbers that are not free in a fit, of the effects that are new in it where it is told which are."""
    new = {k.term for k in fit.knobs if k.effect != TUNE and (fit.fresh is None or k in fit.fresh)}
    return tuple(k for t in fit.terms if t in new for k in problem.space.optional(t) if k not in fit.values)


def with_shown(
    problem: Problem, fits: Sequence[Fit], phi: float, weight: float, settings: SearchSettings
) -> list[Fit | None]:
    """Of each fit, the same with those optional numbers free that may be beyond doubt, fitted roughly; None where none
    are. phi: dispersion of the residuals; weight: of this problem's cost, see `smaller`."""
    starts = _promising(problem, fits, phi / weight, settings)
    begun = [(fit, start) for fit, start in zip(fits, starts, strict=True) if start is not None]
    fresh = [(f.fresh or frozenset()) | frozenset(freed(s)) for f, s in begun]
    fitted = fit_all(
        problem,
        [s for _, s in begun],
        settings.additions.rough,
        rough=True,
        near=[f for f, _ in begun],
        fresh=fresh,
        settings=settings.fit,
    )
    ends = iter(without_nulls(problem, fitted, settings))
    found = [None if start is None else next(ends) for start in starts]
    return [
        end
        if end is not None
        and freed(end.values)
        and _worth(fit, end, phi / weight, settings) > settings.beyond_doubt_most
        and not misplaced(problem.space, end)
        else None
        for fit, end in zip(fits, found, strict=True)
    ]


def without_nulls(problem: Problem, fits: Sequence[Fit], settings: SearchSettings) -> list[Fit]:
    """The fits without those of their optional numbers that ended at their null value, since they can lie on one side
    of it alone: the runs do not show them."""
    fewer = [without_numbers(f.values, *_at_nulls(problem.space, f)) for f in fits]
    gone = [i for i, (f, values) in enumerate(zip(fits, fewer, strict=True)) if values.keys() != f.values.keys()]
    again = fit_all(
        problem, [fewer[i] for i in gone], 1, rough=True, fresh=[fits[i].fresh for i in gone], settings=settings.fit
    )
    out = list(fits)
    for i, fit in zip(gone, again, strict=True):
        out[i] = fit
    return out


def misplaced(space: Space, fit: Fit) -> tuple[Knob, ...]:
    """The optional numbers at a bound that is not their null value: something else is the cause."""
    nulls = _at_nulls(space, fit)
    return tuple(k for k in at_bounds(space, fit) if k not in nulls)


def _at_nulls(space: Space, fit: Fit) -> tuple[Knob, ...]:
    return tuple(
        k
        for k in at_bounds(space, fit)
        if space.null(k) in space.bounds(k) and abs(fit.values[k] - space.null(k)) < 0.5 * np.ptp(space.bounds(k))
    )


def at_bounds(space: Space, fit: Fit) -> tuple[Knob, ...]:
    """The optional numbers that are at a bound, or nearly."""
    ends = {k: space.bounds(k) for k in freed(fit.values)}
    near = {k: AT_BOUND * (high - low) for k, (low, high) in ends.items()}
    return tuple(k for k, (a, b) in ends.items() if not a + near[k] < fit.values[k] < b - near[k])


def unshown(
    space: Space, fit: Fit, finer: Values, most: int, blocks: np.ndarray, settings: FitSettings
) -> tuple[Knob, ...]:
    """The optional numbers to leave out of a fit with all of them free, so that at most so many stay: as many as a 95 %
    region does not tell from their null values together (Wald's test, with the sandwich covariance); of as many, those
    with which the likeliest rest remains, which lies within its bounds with three standard deviations. finer: the
    numbers of the same fit with a finer time step, where it has one: they have to be told apart with any step."""
    knobs = [k for k, held in zip(fit.knobs, fit.held.tolist(), strict=True) if k in freed(fit.values) and not held]
    at = [fit.knobs.index(k) for k in knobs]
    spread = covariance(fit, blocks)[np.ix_(at, at)]
    nulls = np.array([space.null(k) for k in knobs])
    away = np.array([fit.values[k] for k in knobs]) - nulls
    shift = np.array([finer.get(k, fit.values[k]) for k in knobs]) - nulls - away
    bound = np.array([max(map(abs, space.bounds(k))) for k in knobs])
    least = max(len(knobs) - most, 0)
    for count in range(len(knobs), max(least, 1) - 1, -1):
        allowed = np.inf if count == least else float(chdtri(count, settings.evidence.doubt))
        found: dict[tuple[int, ...], float] = {}
        for some in map(list, combinations(range(len(knobs)), count)):
            inverse = np.linalg.pinv(spread[np.ix_(some, some)])
            nearest = away[some] + _towards_null(away[some], shift[some], inverse) * shift[some]
            if (distance := float(nearest @ inverse @ nearest)) < allowed:
                rest = (away - spread[:, some] @ inverse @ away[some]) / bound
                found[tuple(some)] = distance + float(np.sum(np.delete(3.0 * rest, some) ** 2))
        if found:
            return tuple(knobs[i] for i in min(found, key=lambda some: found[some]))
    return ()


def shifts_without(space: Space, whole: Fit, left_out: Sequence[Knob], blocks: np.ndarray) -> tuple[Values, ...]:
    """By how far an optional number that is left out could shift the others: to both ends of its 95 % interval, given
    what the data say of it and that it is within its scale of its null value. One that ended at a bound is not counted.

    If a mass is offset from its site in one direction, it may also be offset in another; its fitted value then changes.
    """
    spread = covariance(whole, blocks)
    out: list[Values] = []
    for knob in left_out:
        k = whole.knobs.index(knob)
        variance = float(spread[k, k])
        if whole.held[k] or not 0.0 < variance < np.inf:
            continue
        prior = space.scale(knob) ** 2
        mean = (whole.values[knob] - space.null(knob)) * prior / (prior + variance)
        half = T95 * np.sqrt(variance * prior / (prior + variance))
        for away in (mean - half, mean + half):
            out.append({j: float(away * spread[i, k] / variance) for i, j in enumerate(whole.knobs) if i != k})
    return tuple(out)


def _towards_null(away: np.ndarray, shift: np.ndarray, inverse: np.ndarray) -> float:
    """The share of a shift (0 to 1) that brings numbers nearest to their null values."""
    size = float(shift @ inverse @ shift)
    return float(np.clip(-(away @ inverse @ shift) / size, 0.0, 1.0)) if size > 0.0 else 0.0


def _worth(fit: Fit, freer: Fit, phi: float, settings: SearchSettings) -> float:
    """The likelihood ratio of a fit with more numbers free, less what each of them has to be worth."""
    return (fit.cost - freer.cost) / phi - settings.per_knob * (len(freer.knobs) - len(fit.knobs))


def _promising(
    problem: Problem, fits: Sequence[Fit], phi: float, settings: SearchSettings
) -> list[dict[Knob, float] | None]:
    """Where the fits with optional numbers begin; None for those in which none is worth it."""
    left = [may_be_shown(problem, fit) for fit in fits]
    tuned = settings.fit.least_squares
    step = tuned.rough_step if problem.space.rough else tuned.step
    moves = [{k: problem.space.null(k) + step * problem.space.scale(k)} for knobs in left for k in knobs]
    owners = [fit for fit, knobs in zip(fits, left, strict=True) for _ in knobs]
    if not moves:
        return [None] * len(fits)
    moved = problem.residuals([{**fit.values, **move} for fit, move in zip(owners, moves, strict=True)])
    out: list[dict[Knob, float] | None] = []
    at = 0
    for fit, knobs in zip(fits, left, strict=True):
        columns = (moved[at : at + len(knobs)] - fit.r).reshape(len(knobs), fit.r.size).T / step
        at += len(knobs)
        chosen = _best(problem, fit, knobs, columns, phi, settings)
        out.append(None if chosen is None else {**fit.values, **chosen})
    return out


def _best(
    problem: Problem, fit: Fit, knobs: Sequence[Knob], columns: np.ndarray, phi: float, settings: SearchSettings
) -> dict[Knob, float] | None:
    """The choice of numbers with the largest likelihood ratio after what each of them has to be worth, at the ends of
    the linear steps to them within their bounds; None where none reaches the least that is ever asked for.

    columns (n, K): derivatives of the residual by the numbers, in their scales.
    """
    basis, r = absorbed(fit), fit.r.ravel()
    columns = columns - basis @ (basis.T @ columns)
    left = r - basis @ (basis.T @ r)
    best, found = settings.beyond_doubt_most, None
    every = chain.from_iterable(combinations(range(len(knobs)), n + 1) for n in range(len(knobs)))
    for some in map(list, every):
        scales = np.array([problem.space.scale(knobs[i]) for i in some])
        nulls = np.array([problem.space.null(knobs[i]) for i in some])
        low, high = np.array([problem.space.bounds(knobs[i]) for i in some]).T
        x = np.linalg.lstsq(columns[:, some], -left, rcond=1e-9)[0]
        x = np.clip(nulls + x * scales, low, high)
        after = left + columns[:, some] @ ((x - nulls) / scales)
        worth = float(left @ left - after @ after) / phi - settings.per_knob * len(some)
        if worth > best:
            best, found = worth, {knobs[i]: float(v) for i, v in zip(some, x, strict=True)}
    return found
