"""Effects of which the last fit, on all windows, makes nothing: they looked like more on the search's few."""

import numpy as np
from scipy.special import chdtri

from residual_mpc.diagnosis.evidence import covariance
from residual_mpc.diagnosis.fit import Fit
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Term

DOUBT = 0.05


def least_sure(fit: Fit, blocks: np.ndarray) -> Term | None:
    """The effect that is the nearest to none among those whose numbers a 95 % region does not tell from none; None
    where every effect is told from none.

    Wald's test of all numbers of an effect at once (Wald 1943), with the sandwich covariance of `evidence`. A
    threshold, whose derivative says little, and what does nothing at infinity are not asked.
    """
    spread = covariance(fit, blocks)
    doubtful: dict[Term, float] = {}
    for term in fit.terms:
        mine = [i for i, k in enumerate(fit.knobs) if k.effect != TUNE and k.term == term]
        kinds = [BY_NAME[term.effect].parameter(fit.knobs[i].parameter) for i in mine]
        if any(p.threshold for p in kinds) or fit.held[mine].any():
            continue
        away = np.array([fit.values[fit.knobs[i]] - p.null for i, p in zip(mine, kinds, strict=True) if not p.shape])
        mine = [i for i, p in zip(mine, kinds, strict=True) if not p.shape]
        if not mine or not np.isfinite(away).all():
            continue
        distance = float(away @ np.linalg.pinv(spread[np.ix_(mine, mine)]) @ away)
        if distance < (most := float(chdtri(len(mine), DOUBT))):
            doubtful[term] = distance / most
    return min(doubtful, key=lambda t: doubtful[t], default=None)
