"""The share of samples that jump, those that were not flagged included.

A small jump hides in the motion and the noise of its channel. How many do is measured: jumps as large as the flagged
ones are put at random places into the same signals, and the share of them that is flagged is the probability of
detection of a jump of that size. A flagged jump then stands for one over its probability (Horvitz and Thompson 1952,
eq. 9). Jumps too small to be ever flagged are not counted.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.signals import Signal
from residual_mpc.logs.jumps import spikes

Key = tuple[int, str]  # run and channel
Jumps = dict[Key, np.ndarray]

DENSITY = 0.01  # share of the samples that is moved at a time
JUMPS = 2000  # moved samples aimed at, in all rounds together
ROUNDS = 20  # most, in short logs
SAMPLES = 200_000  # of a channel that are searched in all rounds together
PIECE = 500  # samples of a long signal that are searched at a time, at least: a jump at an end is never flagged
NEIGHBOURS = 0.1  # share of the moved samples that are nearest in size, over which the probability is averaged
FEWEST = 30  # of these
LEAST = 0.1  # probability: rarer ones would make a single flagged sample stand for dozens


def expected_jumps(signals: Mapping[Key, Signal], flagged: Mapping[Key, np.ndarray], sigma: float) -> Jumps:
    """(n,) number of jumps for which each sample stands, by run and channel: 0 where it is not flagged, and at least 1
    where it is. flagged: (n,) bool, for the runs of one channel; sigma: its noise."""
    parts = [(signals[key].t, signals[key].y, mask) for key, mask in flagged.items()]
    return dict(zip(flagged, _weights(parts, sigma), strict=True))


def _weights(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], sigma: float) -> list[np.ndarray]:
    """(n,) for each signal: stamps, values and flags."""
    sizes = [np.abs(_off_curve(*part)) for part in parts]
    found = np.concatenate([s[m] for s, (_, _, m) in zip(sizes, parts, strict=True)]) if parts else np.empty(0)
    if not len(found):
        return [np.zeros(len(y)) for _, y, _ in parts]
    size, hit = _tried(parts, sigma, found)
    if len(size) < FEWEST:
        return [m.astype(float) for _, _, m in parts]
    width = min(max(FEWEST, int(NEIGHBOURS * len(size))), len(size))
    middle = np.convolve(size, np.ones(width) / width, "valid")
    probability = np.convolve(hit, np.ones(width) / width, "valid")
    return [
        np.where(m, 1.0 / np.maximum(np.interp(s, middle, probability), LEAST), 0.0)
        for s, (_, _, m) in zip(sizes, parts, strict=True)
    ]


def _tried(
    parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], sigma: float, found: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(J,) sizes of jumps that were put into the signals, in ascending order, and (J,) whether each was flagged."""
    rng = np.random.default_rng(len(found))
    total = sum(len(y) for _, y, _ in parts)
    rounds = int(np.clip(np.ceil(JUMPS / (DENSITY * total)), 1, ROUNDS))
    longest = max(SAMPLES // (rounds * len(parts)), PIECE)
    several = min(max(SAMPLES // (rounds * longest), 1), len(parts))
    sizes, hits = [], []
    for _ in range(rounds):
        for t, y, mask in (parts[i] for i in rng.permutation(len(parts))[:several]):
            begin = int(rng.integers(max(len(y) - longest, 0) + 1))
            here = slice(begin, begin + longest)
            moved, clear = y[here].copy(), np.flatnonzero(~mask[here])
            at = rng.permutation(clear)[: rng.binomial(len(clear), DENSITY)]
            size = rng.choice(found, len(at))
            moved[at] += rng.choice((-1.0, 1.0), len(at)) * size
            sizes.append(size)
            hits.append(spikes(t[here], moved, sigma)[at].astype(float))
    size, hit = np.concatenate(sizes), np.concatenate(hits)
    order = np.argsort(size, kind="stable")
    return size[order], hit[order]


def _off_curve(t: np.ndarray, y: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(n,) distance of each sample from the line between the nearest samples that are not flagged."""
    kept = ~mask
    return y - np.interp(t, t[kept], y[kept]) if kept.any() else np.zeros(len(y))
