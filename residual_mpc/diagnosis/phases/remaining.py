"""How much an explanation of all runs leaves, and whether another one leaves far less."""

from collections.abc import Callable

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, per_window
from residual_mpc.diagnosis.fit.evidence import blocks_of
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.options import Progress
from residual_mpc.diagnosis.phases.horizons import everywhere
from residual_mpc.diagnosis.phases.prepare import Prepared
from residual_mpc.diagnosis.phases.refine import Refined
from residual_mpc.diagnosis.phases.search import Searched
from residual_mpc.diagnosis.predict.noise_floor import floor_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.settings import PartSettings
from residual_mpc.models.settings import Values

Finish = Callable[[Searched], Refined]  # fits what a search has found to the end


def much_left(prepared: Prepared, values: Values, rng: np.random.Generator) -> bool:
    """Whether an explanation of all runs leaves far more than noise on the windows that fits may see."""
    data, settings = everywhere(prepared), prepared.options.settings
    row = prepared.space.settings([values])
    left = gap_of(data, prepared.scales, data.y - predict(data, row)[0]).total
    floor = floor_of(data, prepared.scales, row, rng.spawn(1)[0], settings=settings.predict).total
    return bool(left > settings.parts.over_floor * floor)


def window_errors(data: Dataset, scales: Scales, predicted: np.ndarray) -> np.ndarray:
    """(W,) mean squared scaled error of each window. A window whose motion is missed altogether counts as that, also
    where the prediction diverges, and one in which nothing is compared as 0."""
    squares = per_window(data, scales, data.y - predicted)
    return np.where(compared(data), np.minimum(np.nan_to_num(squares, nan=1.0, posinf=1.0), 1.0), 0.0)


def compared(data: Dataset) -> np.ndarray:
    """(W,) bool: the windows in which the gap compares any sample."""
    return np.asarray((np.isfinite(data.y) & data.compared[:, None, :]).any(axis=(1, 2)))


def better(data: Dataset, now: np.ndarray, before: np.ndarray, settings: PartSettings, fits: FitSettings) -> bool:
    """Whether squared errors (W,) are smaller than others by a good part, and in most stretches of time."""
    if not now.sum() < settings.smaller * before.sum():
        return False
    block = blocks_of(data, settings=fits)
    left, had = np.bincount(block, now), np.bincount(block, before)
    usual = max(float(np.median(left)), 1e-12)  # a stretch in which little happens tells little
    saved = np.log((had + usual) / (left + usual))[np.abs(had - left) > settings.alike * usual]
    if len(saved) < settings.stretches:
        return False
    return bool(saved.mean() * np.sqrt(len(saved)) > settings.told * saved.std(ddof=1))


def of_a_part(progress: Progress) -> Progress:
    """The progress of a further search, in a part of the runs."""
    return lambda stage, done: progress(f"{stage} in part of the runs", done)
