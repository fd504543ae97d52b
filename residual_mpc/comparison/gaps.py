"""The gaps of a comparison, on windows that no fit has seen."""

import numpy as np

from residual_mpc.comparison.records import ComparedGap
from residual_mpc.comparison.sets import TwoSets, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import gap_from_squares, gap_of, window_squares
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.noise_floor import floor_of
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.predict.replay import predict, with_outliers_removed
from residual_mpc.models.settings import Values


def compared_gap(
    sets: TwoSets, problem: Problem, fit: Fit, jumping: bool, rng: np.random.Generator, settings: ComparisonSettings
) -> ComparedGap:
    """Of the nominal model, and of the model fitted to the runs before, without and with the changes of `fit`; jumping:
    whether outliers are one of the changes, which are then left out."""
    results = settings.results
    space = problem.space
    before = _fitted_before(sets, problem, fit, settings)
    changed = {k: v for k, v in fit.values.items() if k.changed}
    test = _tested(sets)
    data = sets.raw.take(test)
    data = data.take(_within(sets, data, settings))
    nominal = {k: space.null(k) for k in space.tunables}
    rows = [nominal, before, {**before, **changed}]
    errors = [data.y - p for p in predict(data, space.settings(rows))]
    if jumping:
        flagged = np.isfinite(data.y) & np.isnan(with_outliers_removed(data, sets.outliers.flagged).y)
        errors[2] = np.where(flagged, np.nan, errors[2])
    later = sets.side(data)
    floor = floor_of(data, sets.scales, space.settings([before]), rng, settings=results.predict)

    def total(error: np.ndarray, windows: np.ndarray) -> float:
        return float(gap_of(data, sets.scales, error, windows).total)

    number = units_of(data, sets.later, settings.contrast)

    def spread(error: np.ndarray, windows: np.ndarray) -> float:
        return squared_gap_error(*window_squares(data, sets.scales, error), number, windows)

    channels = {}
    parts = {
        "before": gap_of(data, sets.scales, errors[1], ~later).channels,
        "after": gap_of(data, sets.scales, errors[1], later).channels,
        "after_explained": gap_of(data, sets.scales, errors[2], later).channels,
        "noise_floor": floor.channels,
    }
    for k, c in enumerate(data.channels):
        figures = {name: float(values[k]) for name, values in parts.items()}
        if all(np.isfinite(v) for v in figures.values()):
            channels[c] = figures
    return ComparedGap(
        total(errors[0], ~later),
        total(errors[0], later),
        total(errors[1], ~later),
        total(errors[1], later),
        total(errors[2], later),
        float(np.hypot(spread(errors[1], ~later), spread(errors[2], later))),
        floor.total,
        data.horizon,
        (int((~later).sum()), int(later.sum())),
        channels,
    )


def squared_gap_error(total: np.ndarray, count: np.ndarray, unit: np.ndarray, windows: np.ndarray) -> float:
    """Standard error of the squared gap of these windows (W,) bool, from the jackknife over their units (W,) (Efron and
    Stein 1981); 0 for a single unit. total, count (W, C): see `window_squares`."""
    units = np.unique(unit[windows])
    if len(units) < 2:
        return 0.0
    kept = windows[None, :] & (unit[None, :] != units[:, None])
    squares = gap_from_squares(total, count, kept.astype(float)) ** 2
    return float(np.sqrt((len(units) - 1) / len(units) * np.sum((squares - squares.mean()) ** 2)))


def _tested(sets: TwoSets) -> np.ndarray:
    """(W,) bool: the windows held out, and all of a set of which none is."""
    later = sets.side(sets.raw)
    whole = [side & (sets.held if (sets.held & side).any() else True) for side in (later, ~later)]
    return np.asarray(whole[0] | whole[1])


def _fitted_before(sets: TwoSets, problem: Problem, fit: Fit, settings: ComparisonSettings) -> Values:
    """What acts on both sets, fitted to the runs before alone."""
    start = {k: v for k, v in fit.values.items() if not k.changed}
    mine = ~sets.side(problem.data)
    if not start:
        return start
    return fit_all(part_of(problem, mine), [start], 6, settings=settings.results.fit)[0].values


def _within(sets: TwoSets, data: Dataset, settings: ComparisonSettings) -> np.ndarray:
    """(W,) bool: evenly as many windows of each set as the figures may cost."""
    keep = np.zeros(data.count, dtype=bool)
    later = sets.side(data)
    for side in (later, ~later):
        if side.any():
            steps = settings.search.final_steps
            keep[np.flatnonzero(side)[evenly(data.take(side), steps, settings=settings.results.data)]] = True
    return keep
