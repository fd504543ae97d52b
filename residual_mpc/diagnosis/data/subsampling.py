"""Fewer or shorter windows where all of them would cost more than they tell."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.models.protocol import Drive


def thin(data: Dataset, steps: int, *, settings: DataSettings = DataSettings()) -> Dataset:
    """Less to replay, so that one hypothesis costs at most about `steps` simulation steps: windows cut to their first
    half, and evenly fewer of them."""
    if data.count * max(b.steps for b in data.blocks) > 2 * steps:
        data = shorten(data, 0.5)
    keep = evenly(data, steps, settings=settings)
    return data if keep.all() else data.take(keep)


def thin_whole(data: Dataset, steps: int, settings: DataSettings) -> Dataset:
    """As `thin`, of windows whose length is their point: none is cut short, and a few are always left."""
    keep = evenly(
        data, max(steps, settings.subsampling.fewest_whole * max(b.steps for b in data.blocks)), settings=settings
    )
    return data if keep.all() else data.take(keep)


def evenly(data: Dataset, steps: int, settings: DataSettings) -> np.ndarray:
    """(W,) bool: every so many windows, so that they cost at most about `steps` simulation steps."""
    keep = np.ones(data.count, dtype=bool)
    if data.cost > steps:
        keep[:] = False
        fewest = int(np.ceil(settings.subsampling.fewest / max(data.horizon, 1.0)))
        count = min(max(fewest, steps * data.count // data.cost), data.count)
        keep[np.unique(np.linspace(0, data.count - 1, count).round().astype(int))] = True
    return keep


def _ended(drive: Drive, steps: int) -> Drive:
    """The drive cut to its first steps, the rest of it among what comes after."""

    def parted(now: np.ndarray, after: np.ndarray | None, end: int) -> tuple[np.ndarray, np.ndarray]:
        rest = now[:, end:] if after is None else np.concatenate([now[:, end:], after], axis=1)
        return now[:, :end], rest

    command, later = parted(drive.command, drive.command_after, drive.lead + steps)
    if drive.enabled is None:
        return replace(drive, command=command, command_after=later)
    on, on_later = parted(drive.enabled, drive.enabled_after, steps)
    return replace(drive, command=command, enabled=on, command_after=later, enabled_after=on_later)


def shorten(data: Dataset, part: float) -> Dataset:
    """The same windows cut to their first `part`."""
    horizon = data.horizon * part
    with np.errstate(invalid="ignore"):
        inside = data.t <= horizon
    m = int(inside.sum(axis=1).max())
    blocks = []
    for b in data.blocks:
        steps = int(np.ceil(horizon / b.drive.dt - 1e-9))
        blocks.append(replace(b, drive=_ended(b.drive, steps)))
    t = np.where(inside, data.t, np.nan)[:, :m]
    y = np.where(inside[:, :, None], data.y, np.nan)[:, :m]
    return replace(data, blocks=tuple(blocks), t=t, y=y, horizon=horizon)
