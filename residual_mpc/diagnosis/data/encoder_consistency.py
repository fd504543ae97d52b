"""Channels that no gap compares but that saw what happened upstream: wheel encoders beside a measured pose.

An effect that acts behind the encoders (a radius, a slip) may close the gap of the pose for a cause before them (a weak
motor). The encoders tell: the runs themselves say how far a turn of a wheel carries the robot, so that what the
encoders still read beyond their prediction has a known consequence for the pose. Where that consequence is the very
change of the pose that the effect makes, the effect stands in for something that the encoders saw.

Conversely, an effect before the encoders (a gain) may close the gap of the pose for a cause behind them (a radius).
Where the encoders' errors are what the effect does to their prediction, with the opposite sign, they deny it.
"""

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.settings import DataSettings

POSE = ("pose.x", "pose.y", "pose.theta")


def contradicted(data: Dataset, after: np.ndarray, without: np.ndarray, settings: DataSettings) -> np.ndarray:
    """(T,) bool: which effects stand in for something that the encoders saw, or are denied by them.

    after (W, M, C): the prediction of the whole explanation; without (T, W, M, C): less one effect each. False
    everywhere where there is no independent encoder, or no pose.
    """
    seen = independent_encoders(data)
    if not seen:
        return np.zeros(len(without), dtype=bool)
    x, y, theta = (data.channels.index(c) for c in POSE)
    turned = np.stack([_travelled(data, data.y[..., k]) for k in seen], axis=-1)  # (W, M, K) rad
    missed = np.stack([_travelled(data, data.y[..., k] - after[..., k]) for k in seen], axis=-1)
    moved = _moved(data.y[..., x], data.y[..., y], data.y[..., theta])  # (W, M, 2) m, rad
    good = np.isfinite(moved).all(axis=-1) & np.isfinite(turned).all(axis=-1)
    if good.sum() <= 2 * len(seen):
        return np.zeros(len(without), dtype=bool)
    carries = np.linalg.lstsq(turned[good], moved[good], rcond=None)[0]  # (K, 2): m and rad for a rad of each wheel
    size = np.sqrt(np.mean(moved[good] ** 2, axis=0)) + 1e-12
    consequence = (missed @ carries)[good] / size
    read = [np.isfinite(missed[..., i]) for i in range(len(seen))]
    whole = _moved(after[..., x], after[..., y], after[..., theta])[good] / size
    verdicts = []
    for less in without:
        work = whole - _moved(less[..., x], less[..., y], less[..., theta])[good] / size
        stands_in = np.sum((work - consequence) ** 2) < (1.0 - settings.encoders.accounts) * np.sum(work**2)
        turns = [_travelled(data, after[..., k] - less[..., k])[r] for k, r in zip(seen, read, strict=True)]
        turned_by = np.array([np.sum(turn**2) for turn in turns])
        left = np.array([np.sum((missed[..., i][r] + turns[i]) ** 2) for i, r in enumerate(read)])
        # errors of wheels that it does not turn have other causes
        own = turned_by > settings.encoders.touched * turned_by.max()
        denied = left[own].sum() < (1.0 - settings.encoders.accounts) * turned_by[own].sum()
        verdicts.append(stands_in or bool(denied))
    return np.array(verdicts, dtype=bool)


def independent_encoders(data: Dataset) -> tuple[int, ...]:
    """The measured speeds that no window compares and that are no rate of a state: indices of channels. None where no
    pose is measured, of which they could speak."""
    if not set(POSE) <= set(data.channels):
        return ()
    rates = {s.velocity for b in data.blocks for s in b.robot.states}
    return tuple(
        k
        for k, c in enumerate(data.channels)
        if c.startswith("velocity.") and c not in rates and not data.compared[:, k].any()
    )


def _travelled(data: Dataset, speed: np.ndarray) -> np.ndarray:
    """(W, M) integral of a speed (W, M) since the window's first sample by trapezoids; a missing sample is bridged."""
    out = np.full(speed.shape, np.nan)
    for w, (t, v) in enumerate(zip(data.t, speed, strict=True)):
        good, real = np.isfinite(v) & np.isfinite(t), np.isfinite(t)
        if good.sum() < 2:
            continue
        filled = np.interp(t[real], t[good], v[good])
        steps = 0.5 * (filled[1:] + filled[:-1]) * np.diff(t[real])
        out[w, real] = np.concatenate([[0.0], np.cumsum(steps)])
    return out


def _moved(x: np.ndarray, y: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """(W, M, 2) way along the heading, m, and turn, rad, since the window's first complete sample; NaN where a
    component is missing."""
    good = np.isfinite(x) & np.isfinite(y) & np.isfinite(theta)
    out = np.full((*x.shape, 2), np.nan)
    for w, keep in enumerate(good):
        px, py, heading = x[w, keep], y[w, keep], theta[w, keep]
        if len(px) < 2:
            continue
        middle = 0.5 * (heading[1:] + heading[:-1])
        steps = np.diff(px) * np.cos(middle) + np.diff(py) * np.sin(middle)
        out[w, keep, 0] = np.concatenate([[0.0], np.cumsum(steps)])
        out[w, keep, 1] = heading - heading[0]
    return out
