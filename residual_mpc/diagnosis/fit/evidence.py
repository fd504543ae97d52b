"""How much a drop in cost is worth when residuals are coloured and the model is not the truth."""

from collections.abc import Mapping

import numpy as np
from scipy.special import chdtri

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Term

T95 = 1.96  # half of a 95 % interval over its 1-sigma


def blocks_of(data: Dataset, settings: FitSettings) -> np.ndarray:
    """(W,) block number of each window: stretches of a few seconds of one run."""
    stretch = np.floor((data.start + 1e-9) / max(settings.evidence.block, data.horizon)).astype(int)
    _, number = np.unique(np.stack([data.run, stretch]), axis=1, return_inverse=True)
    return np.asarray(number).ravel()


def without_the_most_telling(difference: np.ndarray, blocks: np.ndarray) -> float:
    """The sum of a difference of costs (W,) without the block that adds most to it, 0 where that turns its sign. A
    joint that sticks in one prediction and slips in the other, once, says little of what moves it."""
    summed = np.bincount(blocks, difference)
    total = float(summed.sum())
    if total > 0.0:
        return max(total - float(summed.max()), 0.0)
    return min(total - float(summed.min()), 0.0)


def dispersion(fit: Fit, blocks: np.ndarray) -> float:
    """tr(H^-1 G) / P with H = J'J and G the covariance of the blocks' gradients: 1 where the residuals are white
    and of the
    assumed size, larger where they are coloured (Takeuchi's criterion; White 1982, eq. 3.2). At least 1."""
    if not fit.knobs:
        return 1.0
    bread, meat = _sandwich(fit, blocks)
    free = ~fit.held
    if not free.any():
        return 1.0
    ratio = np.linalg.lstsq(bread[np.ix_(free, free)], meat[np.ix_(free, free)], rcond=None)[0]
    return float(max(1.0, np.trace(ratio) / free.sum()))


def covariance(fit: Fit, blocks: np.ndarray) -> np.ndarray:
    """(P, P) sandwich covariance of the knobs in their own units; held knobs have zero rows."""
    p = len(fit.knobs)
    out = np.zeros((p, p))
    free = ~fit.held
    if not free.any():
        return out
    bread, meat = _sandwich(fit, blocks)
    inverse = np.linalg.pinv(bread[np.ix_(free, free)])
    n = len(np.unique(blocks))
    small = n / max(n - int(free.sum()), 1)  # few blocks understate the meat
    out[np.ix_(free, free)] = small * inverse @ meat[np.ix_(free, free)] @ inverse
    return np.asarray(out * fit.scales[:, None] * fit.scales[None, :])


def _sandwich(fit: Fit, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    gradients = np.einsum("wnp,wn->wp", fit.jacobian, fit.r)
    summed = np.zeros((blocks.max() + 1, gradients.shape[1]))
    np.add.at(summed, blocks, gradients)
    j = fit.jacobian.reshape(-1, gradients.shape[1])
    bread = j.T @ j
    # never less than what white noise of the residual's own size would give
    white = bread * max(fit.cost / max(float(np.count_nonzero(fit.r)), 1.0), 1e-12)
    meat = summed.T @ summed
    return bread, np.where(np.eye(len(bread), dtype=bool), np.maximum(meat, white), meat)


def profile_sigma(problem: Problem, fit: Fit, phi: float, settings: FitSettings) -> np.ndarray:
    """(P,) standard deviation of each threshold from its cost profile, the others held; 0 for knobs that are no
    threshold.

    A threshold's derivative says little (a dead zone moves in steps), so its interval is where the cost rises by phi.
    For a limit beyond the model's own with a flat cost above, only the lower side counts.
    """
    evidence = settings.evidence
    out = np.zeros(len(fit.knobs))
    for i, knob in enumerate(fit.knobs):
        if knob.effect == TUNE or not BY_NAME[knob.effect].parameter(knob.parameter).threshold:
            continue
        value = fit.values[knob]
        rows = [{**fit.values, knob: value * (1.0 + side * step)} for step in evidence.profile for side in (-1.0, 1.0)]
        cost = np.einsum("hwn,hwn->h", r := problem.residuals(rows), r).reshape(-1, 2)
        risen = (cost - fit.cost) > phi
        sides = [
            evidence.profile[int(np.argmax(risen[:, s]))] if risen[:, s].any() else evidence.profile[-1] for s in (0, 1)
        ]
        open_above = 0.0 < problem.space.reached_limit(knob.term) < value and not risen[:, 1].any()
        out[i] = abs(value) * (sides[0] if open_above else max(sides))
    return out


def least_sure(fit: Fit, blocks: np.ndarray, finer: Mapping[Knob, float], settings: FitSettings) -> Term | None:
    """The effect that is the nearest to none among those whose numbers a 95 % region does not tell from none; None
    where every effect is told from none.

    Wald's test of all numbers of an effect at once (Wald 1943), with the sandwich covariance. A threshold, whose
    derivative says little, what rests on a bound and what does nothing at infinity are not tested, unless they do
    nothing at all. finer: the numbers as a finer time step would have them, by which an effect is also tested: it may
    only stand for the error of the model's own step.
    """
    spread = covariance(fit, blocks)
    doubtful: dict[Term, float] = {}
    for term in fit.terms:
        mine = [i for i, k in enumerate(fit.knobs) if k.effect != TUNE and k.term == term]
        kinds = [BY_NAME[term.effect].parameter(fit.knobs[i].parameter) for i in mine]
        sizes = [(fit.values[fit.knobs[i]], p.null) for i, p in zip(mine, kinds, strict=True) if not p.shape]
        if sizes and all(value == null for value, null in sizes):  # a fit that ended at a bound where nothing is done
            doubtful[term] = 0.0
            continue
        if any(p.threshold for p in kinds) or fit.held[mine].any():
            continue
        pairs = [(fit.knobs[i], p.null) for i, p in zip(mine, kinds, strict=True) if not p.shape]
        mine = [i for i, p in zip(mine, kinds, strict=True) if not p.shape]
        own = np.array([fit.values[k] - null for k, null in pairs])
        there = np.array([finer.get(k, fit.values[k]) - null for k, null in pairs])
        if not mine or not np.isfinite(own).all():
            continue
        distance = _distance(own, there, np.linalg.pinv(spread[np.ix_(mine, mine)]))
        if distance < (most := float(chdtri(len(mine), settings.evidence.doubt))):
            doubtful[term] = distance / most
    return min(doubtful, key=lambda t: doubtful[t], default=None)


def _distance(own: np.ndarray, there: np.ndarray, inverse: np.ndarray) -> float:
    """Wald's distance of numbers from where they do nothing, with either time step: the smaller one, 0 if a finer step
    takes them to the other side. own, there (n,): as they are and with a finer step; inverse (n, n): of their
    covariance."""
    if float(own @ inverse @ there) <= 0.0:
        return 0.0
    return float(min(own @ inverse @ own, there @ inverse @ there))
