"""How a log comes to look like one: stamps, noise, resolution, outliers and dropouts, for all families."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Roughness:
    """What a working day does to a log; the defaults do nothing."""

    jitter: float = 0.0  # standard deviation of the sampling instants, as a share of the period
    colour: float = 0.0  # correlation of the noise from one sample to the next
    dropouts: float = 0.0  # stretches without a sample of a channel group, per 10 s
    resolution: float = 0.0  # quantisation step, in sigmas of the noise
    late: float = 0.0  # s, standard deviation of what the log's stamps are late by, beyond their mean
    lost: float = 0.0  # share of single samples that are missing
    origins: tuple[float, ...] = (0.0,)  # s, stamps at the starts of the runs, by turns


def draw_roughness(rng: np.random.Generator) -> Roughness:
    """The roughness of one case."""
    return Roughness(rng.uniform(0.02, 0.12), rng.uniform(0.2, 0.6), rng.uniform(0.3, 1.0), rng.uniform(0.5, 1.5))


def draw_wild(rate: float, latest: float, rng: np.random.Generator) -> Roughness:
    """The roughness of a log of any kind; noise stays alike for up to 0.3 s, whatever the ``rate`` (Hz).

    latest: s, the most that stamps vary by, so that what moves meanwhile is no more than the sensors' noise.
    """
    colour = float(np.exp(-1.0 / (rate * rng.uniform(0.01, 0.3))))
    since = float(rng.choice([0.0, rng.uniform(1e2, 1e5), rng.uniform(1.6e9, 1.8e9)]))
    return Roughness(
        jitter=float(rng.uniform(0.0, 0.12)),
        colour=min(colour, 0.97),
        dropouts=float(rng.uniform(0.0, 1.0)),
        resolution=float(rng.uniform(0.0, 1.5)),
        late=min(float(rng.uniform(0.0, 0.2)) / rate, latest),
        lost=float(rng.uniform(0.0, 0.05)),
        origins=tuple(float(v) for v in since + np.cumsum(rng.uniform(20.0, 400.0, 5))) if since else (0.0,),
    )


def stamped(t: Array, run: int, rough: Roughness, rng: np.random.Generator) -> Array:
    """What the log calls the instants ``t`` (n,) s of its run number ``run``; still increasing."""
    shift = np.zeros_like(t)
    if rough.late:  # latencies are skewed; their mean would be a delay
        shift = rough.late * (np.minimum(rng.standard_exponential(len(t)), 5.0) - 1.0)
    least, called = 0.02 * float(np.median(np.diff(t))), t + shift
    for k in range(1, len(t) if rough.late else 0):
        called[k] = max(called[k], called[k - 1] + least)
    return called + rough.origins[run % len(rough.origins)]


def stamps(seconds: float, rate: float, rough: Roughness, rng: np.random.Generator) -> Array:
    """Increasing sampling instants (n,) s from 0."""
    n = round(seconds * rate) + 1
    shift = np.clip(rough.jitter * rng.standard_normal(n), -0.4, 0.4)
    shift[0] = 0.0
    return (np.arange(n) + shift) / rate


def jittered(t: Array, rough: Roughness, rng: np.random.Generator) -> Array:
    """The instants (n,) s at which rows meant for ``t``, evenly spaced from 0, are really sent and sampled."""
    return stamps(float(t[-1]), (len(t) - 1) / float(t[-1]), rough, rng)


def noisy(clean: Array, sigma: float, rough: Roughness, rng: np.random.Generator) -> Array:
    """``clean`` (n,) under noise of standard deviation ``sigma``, at the sensor's resolution."""
    white = rng.standard_normal(len(clean))
    if rough.colour:
        white = np.asarray(lfilter([np.sqrt(1 - rough.colour**2)], [1.0, -rough.colour], white))
    return quantised(clean + sigma * white, rough.resolution * sigma)


def quantised(values: Array, step: float) -> Array:
    """``values`` on the grid of ``step``; unchanged where the step is 0."""
    return np.round(values / step) * step if step > 0 else values


def with_dropouts(channels: dict[str, Array], t: Array, per_ten_seconds: float, rng: np.random.Generator) -> None:
    """Blank stretches of 0.1 to 0.5 s in all ``channels`` at once, in place, never in the first second."""
    if t[-1] < 3.0:
        return
    for _ in range(rng.poisson(per_ten_seconds * t[-1] / 10)):
        begin = rng.uniform(1.0, t[-1] - 1.0)
        gone = (t >= begin) & (t < begin + rng.uniform(0.1, 0.5))
        for name in channels:
            channels[name][gone] = np.nan


def outlier_mask(n: int, rate: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Samples (n,) that jump away, each with probability ``rate``; never the first."""
    mask = rng.random(n) < rate
    mask[0] = False
    return mask


def jumps(sigma: float, least: float, most: float, n: int, rng: np.random.Generator) -> Array:
    """How far outliers (n,) lie away: ``least`` to ``most`` sigmas, either way."""
    return np.asarray(sigma * rng.uniform(least, most, n) * rng.choice([-1, 1], n))


def write_table(table: dict[str, Array], name: str, kind: str, folder: Path) -> None:
    """One run as ``name`` with the ending of its kind, csv or parquet."""
    import pandas as pd

    frame = pd.DataFrame(table)
    if kind == "csv" and table["t"][0] > 1e3:  # nine digits do not hold an instant of such a clock
        frame["t"] = [f"{value:.6f}" for value in table["t"]]
    if kind == "csv":
        frame.to_csv(folder / f"{name}.csv", index=False, float_format="%.9g")
    else:
        frame.to_parquet(folder / f"{name}.parquet", index=False)
