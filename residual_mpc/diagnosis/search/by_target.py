"""An effect on all targets alike, told apart by target.

A search adds an effect to all joints or to one. The dry friction of three joints is first found as one number for all,
beside which no joint may have its own. At each step of the search, these numbers are tried as one for each target,
where a linear step promises enough; targets that do not need theirs lose it when the set is pruned.
"""

from collections.abc import Sequence

import numpy as np

from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit, Race, fit_all
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.search.additions import closer
from residual_mpc.diagnosis.search.screen import absorbed, smaller
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term, Values

MOST = 12  # numbers that one effect may become
COUNTED = 2  # effects that one effect on many targets counts as, where the size of a set is limited


def counted(terms: Sequence[Term]) -> int:
    """How many effects a set counts as, never less than half of its terms, whose fits cost time."""
    on = [t.effect for t in terms]
    return max(sum(min(on.count(name), COUNTED) for name in set(on)), (len(on) + 1) // 2)


def by_target(problem: Problem, parent: Fit, blocks: np.ndarray, settings: SearchSettings) -> list[Fit]:
    """The sets in which one of the parent's effects on all targets acts on each by its own number, cheapest first; only
    those that a linear step promises to be beyond doubt are fitted."""
    small, weight = smaller(problem, parent, settings=settings)
    phi = dispersion(parent, blocks)
    here = fit_all(small, [parent.values], 0, settings=settings.fit)[0] if small is not problem else parent
    starts = []
    for term in parent.terms:
        split = _split(problem.space, parent.values, term)
        if split is None:
            continue
        stepped, drop = _linear_step(small, here, split, term, settings)
        knobs = len(split) - len(parent.values)
        if weight * drop / phi >= settings.beyond_doubt_most + settings.per_knob * knobs:
            starts.append(_cheaper(small, split, stepped))
    if not starts:
        return []
    begun = fit_all(small, starts, settings.additions.rough, rough=True, settings=settings.fit)
    margin = settings.additions.hopeless * phi
    fits = closer(problem, small, begun, Race(margin / weight), Race(margin), settings=settings)
    return sorted((f for f in fits if possible(f.values)), key=lambda f: f.cost)


def _split(space: Space, values: Values, term: Term) -> dict[Knob, float] | None:
    """The values with one term as the same on each of its targets; None where these are not several, or have too many
    numbers."""
    own = {k.parameter: v for k, v in values.items() if k.effect != TUNE and k.term == term}
    each = [Term(term.effect, slot) for slot in space.slots[term.effect]]
    if term.target is not None or len(each) < 2 or len(each) * len(own) > MOST or term.changed:
        return None
    if not all(t in space.candidates for t in each):
        return None
    rest = {k: v for k, v in values.items() if k.effect == TUNE or k.term != term}
    found = {Knob(t.effect, t.target, name): v for t in each for name, v in own.items()}
    return {**rest, **{k: float(np.clip(v, *space.bounds(k))) for k, v in found.items()}}


def _linear_step(
    problem: Problem, parent: Fit, split: Values, term: Term, settings: SearchSettings
) -> tuple[dict[Knob, float], float]:
    """The values of a split effect after a linear step of their sizes, clipped to their bounds, and by how much the
    unclipped step is predicted to lower the cost."""
    space, out = problem.space, dict(split)
    free = [
        k
        for k in split
        if k.effect == term.effect and k not in parent.values and not BY_NAME[k.effect].parameter(k.parameter).shape
    ]
    tuned = settings.fit.least_squares
    step = tuned.rough_step if space.rough else tuned.step
    moves = [{**split, k: _moved(space, k, split[k], step)} for k in free]
    sizes = np.array([m[k] - split[k] for m, k in zip(moves, free, strict=True)])
    if not len(free) or not (np.isfinite(sizes) & (sizes != 0.0)).all():
        return out, 0.0
    base, *moved = problem.residuals([split, *moves])
    basis, r = absorbed(parent), base.ravel()
    columns = np.stack([(x.ravel() - r) / s for x, s in zip(moved, sizes, strict=True)], axis=1)
    columns, left = columns - basis @ (basis.T @ columns), r - basis @ (basis.T @ r)
    x = np.linalg.lstsq(columns, -left, rcond=1e-9)[0]
    out.update({k: float(np.clip(split[k] + d, *space.bounds(k))) for k, d in zip(free, x, strict=True)})
    after = left + columns @ x
    return out, float(left @ left - after @ after)


def _cheaper(problem: Problem, split: Values, stepped: Values) -> Values:
    """The start with the lower cost: far from the minimum a linear step may raise it."""
    before, after = np.sum(problem.residuals([split, stepped]).reshape(2, -1) ** 2, axis=-1)
    return stepped if after < before else split


def _moved(space: Space, knob: Knob, value: float, step: float) -> float:
    """A number moved by a small step of its scale, to the side where there is room."""
    size = step * space.scale(knob)
    low, high = space.bounds(knob)
    return value + size if value + size <= high else max(value - size, low)
