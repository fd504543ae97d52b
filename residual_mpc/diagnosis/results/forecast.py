"""Whether a model predicts worse than a forecast of constant velocity."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, per_window
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.results.settings import ResultSettings


def worse_than_forecast(
    data: Dataset,
    scales: Scales,
    error: np.ndarray,
    forecast: np.ndarray,
    judged: np.ndarray,
    settings: ResultSettings,
) -> bool:
    """Whether a model's error (W, M, C) is large, and larger than a forecast's beyond chance: by `certain` standard
    errors of the difference, from stretches of time. judged (W,): weights of the windows."""
    left, other = (gap_of(data, scales, e, judged).total for e in (error, forecast))
    if not left > np.fmax(other, settings.gaps.useless):
        return False
    apart = judged * (per_window(data, scales, error) - per_window(data, scales, forecast))
    stretches = np.bincount(blocks_of(data, settings=settings.fit), weights=np.nan_to_num(apart))
    return bool(stretches.sum() > settings.gaps.certain * np.sqrt((stretches**2).sum()))
