"""Fewer windows where many would cost more than they tell: evenly spread, cut short, or without those badly begun."""

import numpy as np

from residual_mpc.diagnosis.dataset import Dataset
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Scales, per_window
from residual_mpc.diagnosis.screen import shorten
from residual_mpc.models.settings import Settings

POOR_START = 25.0  # times the median of the windows' squared noise
FEWEST_WHOLE = 10  # windows that are left whole
FEWEST = 32  # windows that are left, however small the steps
DRAWS = 24  # the floor hangs on a few windows with poorly measured starts: three draws scatter by a fifth
FEWEST_DRAWS = 6  # of very many windows


def thin(data: Dataset, steps: int) -> Dataset:
    """Less to replay, so that one hypothesis costs at most about `steps` simulation steps: windows cut to their first
    half, and evenly fewer of them."""
    if data.count * max(b.drive.steps for b in data.blocks) > 2 * steps:
        data = shorten(data, 0.5)
    keep = evenly(data, steps)
    return data if keep.all() else data.take(keep)


def thin_whole(data: Dataset, steps: int) -> Dataset:
    """As `thin`, of windows whose length is their point: none is cut short, and FEWEST_WHOLE are left."""
    keep = evenly(data, max(steps, FEWEST_WHOLE * max(b.drive.steps for b in data.blocks)))
    return data if keep.all() else data.take(keep)


def evenly(data: Dataset, steps: int) -> np.ndarray:
    """(W,) bool: every so many windows, so that they cost at most about `steps` simulation steps."""
    keep = np.ones(data.count, dtype=bool)
    if data.cost > steps:
        keep[:] = False
        fewest = int(np.ceil(FEWEST / max(data.horizon, 1.0)))
        count = min(max(fewest, steps * data.count // data.cost), data.count)
        keep[np.unique(np.linspace(0, data.count - 1, count).round().astype(int))] = True
    return keep


def well_begun(data: Dataset, scales: Scales, rng: np.random.Generator) -> Dataset:
    """Without the windows whose start is so poorly measured (dropouts, few samples) that noise alone explains them."""
    noise = per_window(data, scales, noise_errors(data, Settings(1), rng, 1)[0])
    keep = ~(noise > POOR_START * np.nanmedian(noise))
    return data.take(keep) if keep.sum() >= min(FEWEST, data.count) // 2 else data


def floor_draws(data: Dataset, steps: int) -> int:
    """How often the noise is drawn for the floor: as many simulation steps in all as DRAWS times `steps`, so that a
    longer log, whose gap scatters less, does not cost more."""
    cost = data.count * max(b.drive.steps for b in data.blocks)
    return int(np.clip(DRAWS * steps // cost, FEWEST_DRAWS, DRAWS))
