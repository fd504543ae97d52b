"""What the remainder depends on: how much of it each coordinate explains where it was not fitted, and whether chance
would do as much.

Chance is asked by giving every window another one's remainder: the runs change places and each is rotated in time, so
that what is slow stays slow and what belongs together stays together.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.remainder.bases import FORMS, designs
from residual_mpc.diagnosis.remainder.coordinates import PER_RUN, Coordinate
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate
from residual_mpc.diagnosis.remainder.settings import RemainderSettings


@dataclass(frozen=True, eq=False)
class Tried:
    """One coordinate in one form. saved (C, W): drop of the sum of squares of each component in each window, on windows
    that were not fitted; share of what is left beyond the noise; by_chance (draws,): the same on shuffled windows."""

    coordinate: Coordinate
    form: str
    saved: np.ndarray
    share: float
    by_chance: np.ndarray


def try_all(
    data: Dataset,
    missed: Sequence[MissingRate],
    candidates: Sequence[Coordinate],
    motion: Mapping[str, np.ndarray],
    rng: np.random.Generator,
    settings: RemainderSettings,
) -> tuple[Tried, ...]:
    """Every coordinate in every form that fits it, the largest share first."""
    dependence = settings.dependence
    same = np.arange(data.count)
    shuffles = np.stack([same, *(shuffled(data, rng) for _ in range(dependence.draws))])
    moved = np.stack([same, *(displaced(data, rng) for _ in range(dependence.draws))])
    within, across = folds_within(data, settings=settings), folds_across(data, settings=settings)
    beyond = max(sum(m.beyond for m in missed), 1e-12)
    out = []
    for c in candidates:
        folds = within if c.kind in PER_RUN else across
        orders = moved if c.kind in ("run", "order") else shuffles
        for form in FORMS:
            saved = np.zeros((len(missed), data.count))
            total = np.zeros(1 + dependence.draws)
            for k, m in enumerate(missed):
                some = designs(c, form, m.name, data.run, motion, settings=settings)
                if not some:
                    continue
                drop, mine = _saved(m, some, folds, orders, settings=settings)
                total += np.maximum(drop, 0.0)
                saved[k] = mine if drop[0] > 0.0 else 0.0
            if total.any():
                out.append(Tried(c, form, saved, float(total[0] / beyond), total[1:] / beyond))
    return tuple(sorted(out, key=lambda t: -t.share))


def shuffled(data: Dataset, rng: np.random.Generator) -> np.ndarray:
    """(W,) the window whose remainder each window is given."""
    runs = [np.flatnonzero(data.run == i) for i in np.unique(data.run)]
    runs = [r[np.argsort(data.start[r], kind="stable")] for r in runs]
    donors = np.concatenate([np.roll(runs[i], rng.integers(len(runs[i]))) for i in rng.permutation(len(runs))])
    out = np.empty(data.count, dtype=int)
    out[np.concatenate(runs)] = donors
    return out


def displaced(data: Dataset, rng: np.random.Generator) -> np.ndarray:
    """(W,) likewise, but all windows moved on together, over the borders of the runs."""
    order = np.lexsort((data.start, data.run))
    out = np.empty(data.count, dtype=int)
    out[order] = np.roll(order, rng.integers(1, data.count))
    return out


def folds_across(data: Dataset, settings: RemainderSettings) -> np.ndarray:
    """(W,) by run where there are enough of them."""
    there, place = np.unique(data.run, return_inverse=True)
    return place % settings.dependence.folds if len(there) >= 4 else folds_within(data, settings=settings)


def folds_within(data: Dataset, settings: RemainderSettings) -> np.ndarray:
    """(W,) by blocks of windows in a row."""
    out = np.zeros(data.count, dtype=int)
    for i in np.unique(data.run):
        mine = np.flatnonzero(data.run == i)
        mine = mine[np.argsort(data.start[mine], kind="stable")]
        out[mine] = (np.arange(len(mine)) // settings.dependence.block + i) % settings.dependence.folds
    return out


def _saved(
    m: MissingRate, some: list[np.ndarray], folds: np.ndarray, orders: np.ndarray, settings: RemainderSettings
) -> tuple[np.ndarray, np.ndarray]:
    """(1 + draws,) drop of the sum of squares on windows that were not fitted, for the remainder in each order; (W,)
    the first one's drop by window. Of several designs the fitted windows choose."""
    y = m.error[orders]  # (D, W, I)
    best: list[tuple[np.ndarray, np.ndarray]] = []  # by fold: (D,) gain where fitted, (D, W_fold) drop
    for design in some:
        x = np.einsum("wim,wmf->wif", m.response, design) * m.used[:, None, None]
        x = x / (np.sqrt(np.mean(x**2, axis=(0, 1))) + 1e-12)
        gram = np.einsum("wif,wig->wfg", x, x)
        cross = np.einsum("wif,dwi->wfd", x, y)
        for place, fold in enumerate(np.unique(folds)):
            test = folds == fold
            g, c = gram[~test].sum(axis=0), cross[~test].sum(axis=0)
            b = np.linalg.solve(g + settings.dependence.ridge * len(x) * x.shape[1] * np.eye(len(g)), c)  # (F, D)
            gain = 2.0 * np.sum(b * c, axis=0) - np.einsum("fd,fg,gd->d", b, g, b)
            drop = 2.0 * np.einsum("wfd,fd->dw", cross[test], b) - np.einsum("fd,wfg,gd->dw", b, gram[test], b)
            if place == len(best):
                best.append((gain, drop))
            else:
                better = gain > best[place][0]
                best[place] = (np.where(better, gain, best[place][0]), np.where(better[:, None], drop, best[place][1]))
    mine = np.zeros(len(folds))
    total = np.zeros(len(orders))
    for (_, drop), fold in zip(best, np.unique(folds), strict=True):
        total += drop.sum(axis=1)
        mine[folds == fold] = drop[0]
    return total, mine
