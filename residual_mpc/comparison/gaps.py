"""The gaps of a comparison, each window under a model whose fit has not seen it."""

import numpy as np

from residual_mpc.comparison.cross_validation import clear_of, folds_of, refitted
from residual_mpc.comparison.records import ComparedGap
from residual_mpc.comparison.sets import TwoSets, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.diagnosis.data.gap import gap_from_squares, gap_of, window_squares
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.noise_floor import floor_of
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.predict.replay import predict, with_outliers_removed


def compared_gap(
    sets: TwoSets, problem: Problem, fit: Fit, jumping: bool, rng: np.random.Generator, settings: ComparisonSettings
) -> ComparedGap:
    """Of the nominal model, and of the model fitted to the runs before, without and with the changes of `fit`; jumping:
    whether outliers are one of the changes, which are then left out. The numbers of each fold are fitted without it."""
    results = settings.results
    space = problem.space
    data = sets.raw.take(_within(sets, settings))
    later = sets.side(data)
    number = units_of(data, sets.later, settings.contrast)
    folds = folds_of(number, data.run, later, settings.folds)
    clear = [clear_of(fold, folds, data, problem.data) for fold in range(folds.count)]
    earlier = ~sets.side(problem.data)
    part, start = _fitted_before(problem, fit, earlier, settings)
    before = refitted(part, start, [mask[earlier] for mask in clear])
    changed = refitted(problem, fit, clear)
    nominal = {k: space.null(k) for k in space.tunables}
    errors = np.empty((3, *data.y.shape))
    for fold in range(folds.count):
        mine = folds.number == fold
        own = {k: v for k, v in changed[fold].items() if k.changed}
        rows = [nominal, before[fold], {**before[fold], **own}]
        tested = data.take(mine)
        errors[:, mine] = tested.y - predict(tested, space.settings(rows))
    if jumping:
        flagged = np.isfinite(data.y) & np.isnan(with_outliers_removed(data, sets.outliers.flagged).y)
        errors[2] = np.where(flagged, np.nan, errors[2])
    floor = floor_of(data, sets.scales, space.settings([start.values]), rng, settings=results.predict)

    def total(error: np.ndarray, windows: np.ndarray) -> float:
        return float(gap_of(data, sets.scales, error, windows).total)

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
        folds.count,
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


def _fitted_before(
    problem: Problem, fit: Fit, earlier: np.ndarray, settings: ComparisonSettings
) -> tuple[Problem, Fit]:
    """What acts on both sets, fitted to the runs before alone; earlier (W,) bool: the windows of those runs."""
    part = part_of(problem, earlier)
    start = {k: v for k, v in fit.values.items() if not k.changed}
    return part, fit_all(part, [start], 6, settings=settings.results.fit)[0]


def _within(sets: TwoSets, settings: ComparisonSettings) -> np.ndarray:
    """(W,) bool: evenly as many windows of each set as the figures may cost."""
    data = sets.raw
    keep = np.zeros(data.count, dtype=bool)
    later = sets.side(data)
    for side in (later, ~later):
        steps = settings.search.final_steps
        keep[np.flatnonzero(side)[evenly(data.take(side), steps, settings=settings.results.data)]] = True
    return keep
