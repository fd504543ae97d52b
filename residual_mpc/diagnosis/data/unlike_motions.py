"""Windows that are driven unlike those of a fit: what the fit says of them is extrapolated."""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Block, Dataset
from residual_mpc.diagnosis.data.settings import DataSettings


def unlike_share(fitted: Dataset, held: Dataset, settings: DataSettings) -> float:
    """The share, 0 to 1, of `held` windows that are driven unlike all of `fitted`, less what chance makes of it.

    A window is driven unlike the others if its nearest one is farther away than nearly all of the fitted windows'
    nearest ones in other runs (of a single run, in other stretches). Only what was sent counts, and whether the
    actuators were on: nothing of what was measured.
    """
    tuned = settings.unlike
    fitted, held = (d.take(_some(d.count, tuned.windows)) for d in (fitted, held))
    known, asked = _driven(fitted), _driven(held)
    if len(known) < tuned.fewest or not len(asked) or known.shape[1] != asked.shape[1]:
        return 0.0
    sent = np.concatenate([known, asked])
    size = np.maximum(known.std(axis=0), tuned.least * np.ptp(sent, axis=0))
    size[size == 0.0] = 1.0
    several = len(np.unique(fitted.run)) > 1
    place = fitted.run if several else np.floor(fitted.start / (tuned.apart * fitted.horizon)).astype(int)
    apart = _distances(known / size, known / size)
    apart[place[:, None] == place[None, :]] = np.inf
    nearest = apart.min(axis=1)
    if not np.isfinite(nearest).any():
        return 0.0
    reach = float(np.quantile(nearest[np.isfinite(nearest)], tuned.usual))
    share = float(np.mean(_distances(asked / size, known / size).min(axis=1) > reach))
    return max(0.0, (share - (1.0 - tuned.usual)) / tuned.usual)


def _some(count: int, most: int) -> np.ndarray:
    """(count,) bool: at most so many windows, evenly spread."""
    keep = np.zeros(count, dtype=bool)
    keep[np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))] = count > 0
    return keep


def _driven(data: Dataset) -> np.ndarray:
    """(W, 4 nu) how each window is driven: of each actuator the mean of its command, the command's standard deviation
    and mean rate, and the share of the time in which it is on."""
    parts = [_driven_in(block) for block in data.blocks]
    return np.concatenate(parts) if parts else np.zeros((0, 0))


def _driven_in(block: Block) -> np.ndarray:
    drive = block.drive
    u = drive.command[:, drive.lead :]
    on = np.ones_like(u) if drive.enabled is None else drive.enabled
    rate = np.abs(np.diff(u, axis=1)).mean(axis=1) / drive.dt if u.shape[1] > 1 else np.zeros_like(u[:, 0])
    return np.concatenate([u.mean(axis=1), u.std(axis=1), rate, on.mean(axis=1)], axis=1)


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(A, B) between the rows of a (A, F) and of b (B, F), root mean square over the features."""
    square = (a**2).mean(axis=1)[:, None] + (b**2).mean(axis=1)[None, :] - 2.0 * (a @ b.T) / a.shape[1]
    return np.asarray(np.sqrt(np.maximum(square, 0.0)))
