"""Whether an explanation makes the gap smaller on windows that no fit has seen."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.diagnosis.data.gap import gap_of
from residual_mpc.diagnosis.data.left_out import across
from residual_mpc.diagnosis.predict.horizons import HorizonWindows
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.models.settings import Settings


def makes_smaller(
    of: FittedExplanation,
    longer: Sequence[HorizonWindows],
    rows: Settings,
    errors: dict[str, np.ndarray],
    trust: np.ndarray,
    settings: ResultSettings,
) -> bool:
    """Whether the explanation makes the gap noticeably smaller on the windows that are judged: at the headline's
    horizon, or at a longer one without making the headline's larger by more than a little."""
    smaller = np.sqrt(1.0 - settings.gaps.least)
    judged = trust * (of.test & ~across(of.raw, of.aside))
    before, after = (gap_of(of.raw, of.scales, errors[k], judged).total for k in ("before", "after"))
    if after < smaller * before:
        return True
    if after > settings.gaps.worse * before:
        return False
    for look in longer:
        if of.held.any() and not look.held.any():
            continue  # its windows have been fitted to
        there = look.test & ~across(look.raw, of.aside)
        if not there.any():
            continue
        raw = look.raw.take(there)
        seen = look.clean.take(there) if of.with_outliers else raw
        _, was, now = predict(raw, rows)
        if gap_of(seen, look.scales, seen.y - now).total < smaller * gap_of(raw, look.scales, raw.y - was).total:
            return True
    return False
