"""The visibility of a change in recorded runs: its size relative to the scatter of these runs without it.

The change is put into both halves. In each unit (a run or a stretch of one) the errors of the nominal model are
projected onto the difference that the change makes to them; the full change shifts this estimate by one. The visibility
is that shift divided by the standard error of the difference between the halves: the z of a test that knows which
change to look for. It uses neither the search nor the common model of `compare`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtri, stdtrit

from residual_mpc.blind.recorded.case_files import HALVES, write_case
from residual_mpc.blind.recorded.half import Half
from residual_mpc.models.robot_file import RobotFile

STEPS = 60_000  # simulation steps of one replay of both halves
STRETCH = 3.0  # s, length of a unit if there are few runs
FEW_RUNS = 6  # runs in a half, below which stretches of runs are the units
BINS = 10  # of a window
MAD = 1.4826  # standard deviations in a median absolute deviation of a normal distribution
ALTERNATIVES = 40  # changes that a comparison chooses from: about as many as the library has effects
FALSE_ALARM = 0.02  # probability of a false change, over all of them together
CLIP = 1.5  # standard deviations at which Huber's estimate limits a unit
CLIPPED = 0.7784  # mean square of a standard normal variable that is clipped there
ROUNDS = 30  # of the iteration to that estimate
POWER = 0.8  # probability with which a barely visible change is detected


@dataclass(frozen=True, eq=False)
class WindowErrors:
    """Errors of the nominal model in W windows. key (W, 2): number of the run within both halves, and of the window
    within the run; later (W,) bool: whether the run is in the second half; start (W,) s; errors (W, BINS, C): averaged
    over equal parts of the window, each channel divided by the size of its motion, NaN if missing. noise: 1-sigma of
    each channel."""

    key: np.ndarray
    later: np.ndarray
    start: np.ndarray
    errors: np.ndarray
    noise: Mapping[str, float]


def window_errors(
    robot: RobotFile, before: Half, after: Half, noise: Mapping[str, float] | None = None
) -> WindowErrors:
    """The errors in windows of one second, evenly subsampled to at most STEPS simulation steps. noise: 1-sigma of each
    channel; estimated if not given."""
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.run_models import RunModels
    from residual_mpc.diagnosis.data.dataset import build_dataset
    from residual_mpc.diagnosis.data.gap import measure_scales
    from residual_mpc.diagnosis.data.settings import DataSettings
    from residual_mpc.diagnosis.data.subsampling import evenly
    from residual_mpc.diagnosis.predict.replay import predict
    from residual_mpc.logs.readers.read import read_runs
    from residual_mpc.models.settings import Settings

    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case"
        case.mkdir()
        write_case(case, robot, before, after)
        loaded = load_robot(case / "robot.toml")
        halves = [read_runs([case / half], loaded.file).runs for half in HALVES]
        models = RunModels(loaded)
        runs = [run for half in halves for run in half]
        data = build_dataset(runs, [models.of(r.name) for r in runs], noise or loaded.file.noise)
    scales = measure_scales(data)
    number = data.run.copy()
    order = np.zeros(data.count, dtype=int)
    for run in np.unique(number):
        order[number == run] = np.argsort(np.argsort(data.start[number == run]))
    keep = evenly(data, STEPS, settings=DataSettings())
    few = data.take(keep)
    errors = (few.y - predict(few, Settings(1))[0]) / scales.s
    errors[:, :, scales.still] = np.nan
    key = np.column_stack([number, order])[keep]
    binned = _binned(few.t / few.horizon, errors)
    sigma = dict(zip(data.channels, data.sigma.tolist(), strict=True))
    return WindowErrors(key, key[:, 0] >= len(halves[0]), few.start, binned, sigma)


def visibility(untouched: WindowErrors, changed: WindowErrors) -> float:
    """z of the change that leads from one to the other, at least 0; 0 if no unit shows it."""
    _, mine, its = np.intersect1d(_flat(untouched), _flat(changed), return_indices=True)
    e, moved = untouched.errors[mine], changed.errors[its]
    there = np.isfinite(e) & np.isfinite(moved)
    e, d = np.where(there, e, 0.0), np.where(there, moved - e, 0.0)
    unit, later = _units(untouched, mine)
    size, score = np.zeros(len(later)), np.zeros(len(later))
    np.add.at(size, unit, np.einsum("wmc,wmc->w", d, d))
    np.add.at(score, unit, np.einsum("wmc,wmc->w", d, e))
    seen = size > 1e-6 * size.max(initial=0.0)
    if min(np.count_nonzero(seen & later), np.count_nonzero(seen & ~later)) < 2:
        return 0.0
    estimate, later = score[seen] / size[seen], later[seen]
    weight = size[seen] / (size[seen] + np.median(size[seen]))
    return 1.0 / (_standard_error(estimate, weight, later) + 1e-9)


def _standard_error(y: np.ndarray, weight: np.ndarray, later: np.ndarray) -> float:
    """Of the difference between two sets in Huber's estimate of location (Huber 1981, sections 3.2 and 6.3): y, weight
    (U,), later (U,) bool. A spread from medians alone would be too small where more than half of the units agree by
    chance, or where runs come in groups."""
    root = np.sqrt(weight)
    at = np.where(later, np.median(y[later]), np.median(y[~later]))
    scale = MAD * float(np.median(root * np.abs(y - at))) + 1e-12
    for _ in range(ROUNDS):
        inside = np.minimum(1.0, CLIP / np.maximum(root * np.abs(y - at) / scale, 1e-12))
        means = [np.average(y[side], weights=(weight * inside)[side]) for side in (~later, later)]
        at = np.where(later, means[1], means[0])
        residual = root * (y - at)
        clipped = np.clip(residual / scale, -CLIP, CLIP)
        scale = max(float(np.sqrt(np.mean(clipped**2) / CLIPPED)) * scale, 1e-12)
    clipped = np.clip(residual / scale, -CLIP, CLIP)
    free = np.abs(residual) < CLIP * scale
    variance = 0.0
    for side in (~later, later):
        n = int(np.count_nonzero(side))
        slope = max(float(np.sum((weight * free)[side])), 0.5 * float(weight[side].min()))
        variance += n / (n - 1) * scale**2 * float(np.sum((weight * clipped**2)[side])) / slope**2
    return float(np.sqrt(variance))


def faintest(untouched: WindowErrors) -> float:
    """The visibility of a barely visible change: a test of ALTERNATIVES changes, with Bonferroni's correction, detects
    it with a probability of POWER."""
    _, later = _units(untouched, np.arange(len(untouched.key)))
    critical = stdtrit(max(len(later) - 2, 1), 1.0 - 0.5 * FALSE_ALARM / ALTERNATIVES)
    return float(critical + ndtri(POWER))


def _binned(part: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """(W, BINS, C) means of the errors (W, M, C) of samples at the fractions `part` (W, M) of the window. Means are
    compared because a change may move the stamps, and single samples are noisy."""
    out = np.full((len(errors), BINS, errors.shape[2]), np.nan)
    with np.errstate(invalid="ignore"):
        place = np.clip(np.floor(part * BINS), 0, BINS - 1)
    for k in range(BINS):
        here = np.where((place == k)[:, :, None], errors, np.nan)
        count = np.isfinite(here).sum(axis=1)
        out[:, k] = np.where(count > 0, np.nansum(here, axis=1) / np.maximum(count, 1), np.nan)
    return out


def _flat(of: WindowErrors) -> np.ndarray:
    return np.asarray(of.key[:, 0] * 1_000_000 + of.key[:, 1])


def _units(of: WindowErrors, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(W,) the unit of each of these windows, and (U,) bool whether a unit belongs to the later half."""
    run, later = of.key[rows, 0], of.later[rows]
    stretch = np.zeros(len(rows), dtype=int)
    if min(len(np.unique(run[later])), len(np.unique(run[~later]))) < FEW_RUNS:
        stretch = (of.start[rows] / STRETCH).astype(int)
    _, unit = np.unique(run * 1_000_000 + stretch, return_inverse=True)
    side = np.zeros(int(unit.max(initial=-1)) + 1, dtype=bool)
    side[unit] = later
    return unit, side
