"""The gaps of a comparison, each window under a model whose fit has not seen it."""

import numpy as np

from residual_mpc.comparison.cross_validation import clear_of, folds_of, refitted
from residual_mpc.comparison.leads import changed_terms, without_change
from residual_mpc.comparison.records import ComparedGap, GapRise, Predicted
from residual_mpc.comparison.sets import TwoSets, units_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.diagnosis.data.gap import gap_of, per_window
from residual_mpc.diagnosis.data.outliers import with_outliers_removed
from residual_mpc.diagnosis.data.subsampling import evenly
from residual_mpc.diagnosis.fit.least_squares import Fit, fit_all
from residual_mpc.diagnosis.predict.noise_floor import floor_of
from residual_mpc.diagnosis.predict.problem import Problem, part_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.models.settings import Term

WHOLE = 1.0  # squared gap of a window in which a model misses the whole motion


def compared_gap(
    sets: TwoSets,
    problem: Problem,
    fit: Fit,
    jumping: bool,
    rng: np.random.Generator,
    settings: ComparisonSettings,
) -> ComparedGap:
    """Of the nominal model, of the model fitted to the runs before, and of the model fitted to both sets with the
    changes of `fit`: other motions after may show what the runs before leave open about the robot, which is no change.
    jumping: whether outliers are one of the changes, which are then left out. The numbers of each fold are fitted
    without it."""
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
    alone = _unchanged(problem, fit, settings)
    named = jumping or alone is not fit
    unchanged = changed if alone is fit else refitted(problem, alone, clear)
    terms = changed_terms(fit)
    without = {t: alone if len(terms) == 1 else _without(problem, fit, t, settings) for t in terms}
    fewer = [unchanged if less is alone else refitted(problem, less, clear) for less in without.values()]
    nominal = {k: space.null(k) for k in space.tunables}
    errors = np.empty((4 + len(fewer), *data.y.shape))
    for fold in range(folds.count):
        mine = folds.number == fold
        rows = [nominal, before[fold], unchanged[fold], changed[fold] if named else before[fold]]
        rows += [less[fold] for less in fewer]
        tested = data.take(mine)
        errors[:, mine] = tested.y - predict(tested, space.settings(rows))
    if jumping:
        flagged = np.isfinite(data.y) & np.isnan(with_outliers_removed(data, sets.outliers.flagged).y)
        errors[3:] = np.where(flagged, np.nan, errors[3:])
    floor = floor_of(data, sets.scales, space.settings([start.values]), rng, settings=results.predict)

    def total(error: np.ndarray, windows: np.ndarray) -> float:
        return float(gap_of(data, sets.scales, error, windows).total)

    squares = [per_window(data, sets.scales, e) for e in errors[1:]]
    channels = {}
    parts = {
        "before": gap_of(data, sets.scales, errors[1], ~later).channels,
        "after": gap_of(data, sets.scales, errors[1], later).channels,
        "after_explained": gap_of(data, sets.scales, errors[3], later).channels,
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
        total(errors[3], later),
        rise_of(squares[0], squares[1], squares[2], later, number),
        floor.total,
        data.horizon,
        (int((~later).sum()), int(later.sum())),
        folds.count,
        channels,
        {t: predicted_of(less, squares[2], number) for t, less in zip(without, squares[3:], strict=True)},
    )


def rise_of(before: np.ndarray, same: np.ndarray, changed: np.ndarray, later: np.ndarray, unit: np.ndarray) -> GapRise:
    """From the windows' own squared gaps (W,) under the model fitted to the runs before, and under that fitted to both
    sets without and with the changes; later (W,) bool: the windows after; unit (W,) number of each one's stretch. The
    errors are the jackknife's over stretches (Efron and Stein 1981)."""
    sides = ((before, ~later), (same, later), (changed, later))
    (first, its), (after, risen), (explained, left) = (_mean(x, unit, mine & np.isfinite(x)) for x, mine in sides)
    return GapRise(after - first, explained - first, float(np.hypot(its, risen)), float(np.hypot(its, left)))


def predicted_of(without: np.ndarray, changed: np.ndarray, unit: np.ndarray) -> Predicted:
    """What a change predicts, from the windows' own squared gaps (W,) without it and with it; unit (W,)."""
    seen = np.isfinite(without) & np.isfinite(changed)
    difference = np.minimum(without, WHOLE) - np.minimum(changed, WHOLE)
    gain, error = _mean(difference, unit, seen)
    means = [difference[seen & (unit == u)].mean() for u in np.unique(unit[seen])]
    return Predicted(gain, error, float(np.mean(np.array(means) > 0.0)) if means else 0.0)


def _mean(squares: np.ndarray, unit: np.ndarray, windows: np.ndarray) -> tuple[float, float]:
    """The mean over these windows (W,) bool, and its standard error: 0 for a single stretch, NaN without a window."""
    x, unit = np.minimum(squares[windows], WHOLE), unit[windows]
    if not len(x):
        return float("nan"), float("nan")
    units = np.unique(unit)
    if len(units) < 2:
        return float(x.mean()), 0.0
    less = np.array([x[unit != u].mean() for u in units])
    return float(x.mean()), float(np.sqrt((len(units) - 1) / len(units) * np.sum((less - less.mean()) ** 2)))


def _unchanged(problem: Problem, fit: Fit, settings: ComparisonSettings) -> Fit:
    """The fit to both sets without its changes."""
    start = {k: v for k, v in fit.values.items() if not k.changed}
    return fit if len(start) == len(fit.values) else fit_all(problem, [start], 6, settings=settings.results.fit)[0]


def _without(problem: Problem, fit: Fit, term: Term, settings: ComparisonSettings) -> Fit:
    """The fit to both sets without one of its changes."""
    fits = settings.results.fit
    return fit_all(problem, [without_change(fit.values, term)], 6, settings=fits)[0]


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
