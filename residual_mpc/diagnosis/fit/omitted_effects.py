"""How far the numbers of a fit move if one more small effect is fitted with them.

An effect that is too small to be named biases the numbers of the named ones, often by more than their standard error
(omitted-variable bias; Greene, Econometric Analysis, 2018, chapter 4): a lag of 8 ms makes a dead time 8 ms longer.
The derivatives tell which small effects matter; those are then fitted.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import Problem, tolerating, whitened
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.predict.tolerances import Difference
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Term, Values


@dataclass(frozen=True, eq=False)
class _Direction:
    """A difference, of one target or of all alike, and the columns whose sum with these weights is how one step of it
    moves the prediction."""

    difference: Difference
    columns: tuple[int, ...]
    weights: tuple[float, ...]


def shifts_beside(
    carried: Problem, fit: Fit, differences: Sequence[Difference], steps: int, settings: FitSettings
) -> tuple[Values, ...]:
    """Shifts of the numbers of the fit when one more small effect is fitted, for the few effects that shift them most
    among those that the residuals support.

    Args:
        carried: the problem of the fit, carrying the columns of the differences, which come first.
        steps: of each of these fits.
    """
    assert carried.tolerances is not None
    plain = tolerating(carried, None)
    directions = _directions(carried.space, fit, differences)
    if not directions or not fit.knobs or fit.held.all():
        return ()
    columns = carried.tolerances.columns
    sums = np.stack([columns[..., list(d.columns)] @ np.array(d.weights) for d in directions], axis=-1)
    sizes, worth, moves = _linear(plain, fit, -whitened(plain, sums), settings)
    sizes = np.clip(sizes, *np.transpose([_reach(carried.space, d.difference) for d in directions]))
    far = np.max(np.abs(moves * sizes), axis=0, initial=0.0)
    shown = [i for i in np.argsort(-far) if worth[i] > settings.omitted.shown and far[i] > 0.0]
    order = shown[: settings.omitted.most]
    if not order:
        return ()
    starts = [{**fit.values, **directions[i].difference.scaled(float(sizes[i]))} for i in order]
    out = []
    for beside in fit_all(plain, starts, steps, rough=True, settings=settings):
        if beside.cost < fit.cost:
            out.append({k: beside.values[k] - fit.values[k] for k in fit.knobs})
    return tuple(out)


def _directions(space: Space, fit: Fit, differences: Sequence[Difference]) -> list[_Direction]:
    """Each difference that may join the set, and each effect that may act on all of its targets alike."""
    out = [_Direction(d, (i,), (1.0,)) for i, d in enumerate(differences) if space.may_join(d.knob.term, fit.terms)]
    alike = defaultdict[tuple[object, ...], list[int]](list)
    for i, d in enumerate(differences):
        shape = tuple(v for k, v in d.own.items() if BY_NAME[k.effect].parameter(k.parameter).shape)
        alike[(d.knob.effect, d.knob.parameter, shape)].append(i)
    for places in alike.values():
        one = differences[places[0]]
        everywhere = Term(one.knob.effect, None)
        whole = len(places) > 1 and len(places) == len(space.slots[one.knob.effect])
        if whole and BY_NAME[one.knob.effect].null_target and space.may_join(everywhere, fit.terms):
            own = {k._replace(target=None): v for k, v in one.own.items()}
            difference = Difference(one.knob._replace(target=None), one.step, own, {**fit.values, **own})
            out.append(_Direction(difference, tuple(places), tuple(one.step / differences[i].step for i in places)))
    return out


def _linear(
    problem: Problem, fit: Fit, columns: np.ndarray, settings: FitSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K,) the size of each difference beside the fit, in its steps; (K,) the square of that over its variance; (P, K)
    how far the fit's numbers move for each step, in their scales. columns (W * n, K): derivatives of the residuals."""
    blocks = blocks_of(problem.data, settings=settings)
    free = ~fit.held
    basis, upper = np.linalg.qr(fit.jacobian.reshape(len(columns), -1)[:, free])
    along = basis.T @ columns
    own = columns - basis @ along
    r = fit.r.ravel() - basis @ (basis.T @ fit.r.ravel())
    seen = np.maximum(np.einsum("nk,nk->k", own, own), 1e-12)
    raw = -(own.T @ r) / seen
    worth = np.zeros(len(raw))
    for i, size in enumerate(raw):
        left = r + size * own[:, i]
        scores = np.bincount(blocks, (own[:, i] * left).reshape(fit.r.shape).sum(axis=1))
        meat = max(float(scores @ scores), seen[i] * float(left @ left) / max(np.count_nonzero(left), 1))
        worth[i] = (size * seen[i]) ** 2 / max(meat, 1e-300)
    shrunk = raw * worth / (1.0 + worth)
    moves = np.zeros((len(fit.knobs), len(raw)))
    moves[free] = -np.linalg.lstsq(upper, along, rcond=None)[0]
    return shrunk, worth, moves


def _reach(space: Space, difference: Difference) -> tuple[float, float]:
    """Of how many steps a difference may be inside the bounds of its number."""
    at = difference.own[difference.knob] - difference.step
    ends = sorted((end - at) / difference.step for end in space.bounds(difference.knob))
    return ends[0], ends[1]
