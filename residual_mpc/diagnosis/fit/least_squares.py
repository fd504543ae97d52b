"""Least-squares fits of many hypotheses in lockstep: every trial step and every derivative of all of them is one batch.

Levenberg-Marquardt with bounds by projection (Nocedal and Wright, Numerical Optimization, 2006, section 10.3); up to
three dampings are tried at once, since rows of a batch are cheap. A nominal parameter that the user would retune is
fitted by its logarithm where it is positive: a guessed gain may be off by decades.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.fit.start_values import possible
from residual_mpc.diagnosis.predict.effect_sets import EffectSet
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import TUNE, Knob, Values

SHARE = 0.3  # typical step of a retuned parameter, of its value
FARTHEST = 5.0  # of these steps at once: a factor of 4.5
DECADES = 1e5  # factor by which a retuned parameter may leave its nominal value


@dataclass(frozen=True)
class Fit:
    """values by knob; cost: sum of squares of the whitened residual r (W, n); jacobian (W, n, P) per scaled knob, the
    scales beside it, in the order of `knobs`. `held` (P,) marks knobs that rest on a bound; `fresh`: see `fit_all`."""

    terms: EffectSet
    knobs: tuple[Knob, ...]
    values: Values
    scales: np.ndarray
    cost: float
    r: np.ndarray
    jacobian: np.ndarray
    held: np.ndarray
    fresh: frozenset[Knob] | None = None

    @property
    def per_window(self) -> np.ndarray:
        """(W,) sum of squares of each window."""
        return np.einsum("wn,wn->w", self.r, self.r)


@dataclass(frozen=True)
class Race:
    """Of many fits only those matter that end within `margin` of the cheapest, or of `mark` where that is cheaper.
    `early`: times the margin by which a start may lie behind; starts that were fitted on part of the windows are near
    their end."""

    margin: float
    mark: float = np.inf
    early: float = np.inf


@dataclass
class _Run:
    """The moving state of one fit."""

    knobs: tuple[Knob, ...]
    x: np.ndarray  # scaled
    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray
    ratio: np.ndarray  # bool: whether it multiplies a nominal number
    logarithmic: np.ndarray  # bool: a number is scale * exp(x SHARE), else scale * x
    r: np.ndarray
    cost: float
    stale: int  # steps since the Jacobian was measured, more than `secants` before it ever was
    fresh: frozenset[Knob] | None = None
    lent: dict[int, np.ndarray] = field(default_factory=dict)  # knob's place -> column of a fit that it starts from
    jacobian: np.ndarray | None = None
    damping: float = 1e-2
    gained: float = np.inf  # the last drop in cost
    done: bool = False
    behind: bool = False  # left where it is, without hope of coming first
    failures: int = 0
    width: float = 0.3  # of the scan of thresholds, relative

    def values(self, x: np.ndarray) -> dict[Knob, float]:
        numbers = np.where(self.logarithmic, self._grown(x), x) * self.scale
        return {k: float(v) for k, v in zip(self.knobs, numbers, strict=True)}

    def local_scale(self) -> np.ndarray:
        """(P,) derivative of each number by x."""
        return np.where(self.logarithmic, SHARE * self._grown(self.x), 1.0) * self.scale

    def _grown(self, x: np.ndarray) -> np.ndarray:
        """(P,) exp(x SHARE) where a number is logarithmic, 1 elsewhere."""
        return np.asarray(np.exp(SHARE * np.where(self.logarithmic, x, 0.0)))


def fit_all(
    problem: Problem,
    starts: Sequence[Values],
    most: int | None = None,
    tolerance: float = 3e-4,
    race: "Race | None" = None,
    secants: int | None = None,
    rough: bool = False,
    near: "Sequence[Fit | None]" = (),
    fresh: Sequence[frozenset[Knob] | None] = (),
    *,
    settings: FitSettings = FitSettings(),
) -> list[Fit]:
    """Fit each start's own knobs; the result keeps the order. Memory grows with len(starts) * knobs * samples.

    most: steps; secants: of these on a Jacobian that is updated by what the steps showed (see `_advance`); None for the
    settings' own. The Jacobian is measured at the end, save for what was left behind, and unless it is wanted `rough`
    (zeros where no step was taken). race: which fits are left where they are once they cannot come first. near: for
    each start a fit on this problem whose derivatives by the knobs that the two share will do for the first steps.
    fresh: for each start the knobs whose thresholds are looked for on both sides, the others being near their place
    already; None, and where nothing is said: all.
    """
    if not starts:
        return []
    most = settings.least_squares.most if most is None else most
    secants = settings.least_squares.secants if secants is None else secants
    residuals = problem.residuals(starts)
    lenders, new = near or [None] * len(starts), fresh or [None] * len(starts)
    runs = [
        _begin(problem, s, r, n, f, settings=settings)
        for s, r, n, f in zip(starts, residuals, lenders, new, strict=True)
    ]
    if race is not None:
        reach = min([r.cost for r in runs] + [race.mark]) + race.early * race.margin
        for run in runs:
            run.done = run.behind = run.cost > reach
    for _ in range(most):
        active = [run for run in runs if not run.done and run.knobs]
        if not active:
            break
        _derive(problem, [run for run in active if run.stale > secants], settings=settings)
        _advance(problem, active, tolerance, settings=settings)
        if race is not None:
            _leave_behind(active, min([r.cost for r in runs] + [race.mark]) + race.margin, settings=settings)
    for run in runs:
        if run.jacobian is None and (rough or run.behind):  # nobody asks for it
            run.jacobian = np.zeros((*run.r.shape, len(run.knobs)))
    _derive(
        problem, [r for r in runs if r.jacobian is None or (r.stale and not r.behind and not rough)], settings=settings
    )
    return [_finish(run) for run in runs]


def _leave_behind(runs: list[_Run], reach: float, settings: FitSettings) -> None:
    """Stop the fits that lie beyond reach by more than they are likely still to fall."""
    for run in runs:
        if run.cost - settings.least_squares.remaining * run.gained > reach:
            run.done = run.behind = True


def _begin(
    problem: Problem,
    start: Values,
    r: np.ndarray,
    near: Fit | None = None,
    fresh: frozenset[Knob] | None = None,
    *,
    settings: FitSettings,
) -> _Run:
    knobs = tuple(start)
    scale = np.array([problem.space.scale(k) for k in knobs])
    bounds = np.array([problem.space.bounds(k) for k in knobs]).reshape(-1, 2) / scale.reshape(-1, 1)
    x = np.array([start[k] for k in knobs]) / scale
    logarithmic = np.array([k.effect == TUNE and problem.space.null(k) > 0 and start[k] > 0 for k in knobs], dtype=bool)
    for i in np.flatnonzero(logarithmic):
        scale[i] = problem.space.null(knobs[i])
        x[i] = np.log(start[knobs[i]] / scale[i]) / SHARE
        bounds[i] = -np.log(DECADES) / SHARE, np.log(DECADES) / SHARE
    ratio = np.array([problem.space.null(k) == 1.0 and k.effect != TUNE for k in knobs], dtype=bool)
    shared = () if near is None else (k for k in knobs if k in near.knobs)
    lent = {} if near is None else {knobs.index(k): near.jacobian[..., near.knobs.index(k)] for k in shared}
    return _Run(
        knobs,
        x,
        bounds[:, 0],
        bounds[:, 1],
        scale,
        ratio,
        logarithmic,
        r,
        float(np.sum(r * r)),
        settings.least_squares.secants + 1,
        fresh,
        lent,
    )


def _derive(problem: Problem, runs: list[_Run], settings: FitSettings) -> None:
    """Measure the Jacobians, save for the columns that a run begins with."""
    least_squares = settings.least_squares
    usual = least_squares.rough_step if problem.space.rough else least_squares.step
    rows: list[Values] = []
    steps: list[float] = []
    for run in runs:
        for i in range(len(run.knobs)):
            if i in run.lent:
                continue
            # a delay's or play's derivative at its null is one-sided; away from it the upper side serves as well
            step = min(usual, least_squares.relative_step * abs(run.x[i])) if run.ratio[i] else usual
            step = step if run.x[i] + step <= run.high[i] else -step
            x = run.x.copy()
            x[i] += step
            rows.append(run.values(x))
            steps.append(step)
    if rows:
        moved = problem.residuals(rows)
    at = 0
    for run in runs:
        columns = []
        for i in range(len(run.knobs)):
            if i in run.lent:
                columns.append(run.lent[i])
            else:
                columns.append((moved[at] - run.r) / steps[at])
                at += 1
        run.jacobian = np.stack(columns, axis=-1) if columns else np.zeros((*run.r.shape, 0))
        run.stale, run.lent = (1 if run.lent else 0), {}


def _advance(problem: Problem, runs: list[_Run], tolerance: float, settings: FitSettings) -> None:
    trials: list[tuple[_Run, float, np.ndarray]] = []
    for run in runs:
        trials += [(run, damping, x) for damping, x in _distinct_steps(run, settings=settings)]
        trials += [(run, run.damping, x) for x in _scan(run)]
    tried = [run.values(x) for run, _, x in trials]
    results = problem.residuals(tried)
    costs = np.einsum("hwn,hwn->h", results, results)
    costs = np.where([possible(values) for values in tried], costs, np.inf)
    for run in runs:
        assert run.jacobian is not None
        mine = [i for i, (owner, _, _) in enumerate(trials) if owner is run]
        best = mine[int(np.argmin(costs[mine]))]
        if costs[best] < run.cost:
            run.gained = run.cost - float(costs[best])
            run.done = run.gained < tolerance * run.cost
            _, damping, x = trials[best]
            step = x - run.x
            # Broyden's rank-one update: the Jacobian that predicts what this step did (Nocedal and Wright, eq. 11.17)
            missed = results[best] - run.r - run.jacobian @ step
            run.jacobian = run.jacobian + missed[..., None] * (step / max(float(step @ step), 1e-30))
            run.x, run.r, run.cost = x, results[best].copy(), float(costs[best])
            run.stale += 1
            run.damping = float(np.clip(damping, 1e-7, 1e6))
            run.failures = 0
        elif run.stale:
            run.stale = (
                settings.least_squares.secants + 1
            )  # a Jacobian that was only updated misleads: it is measured before the next step
        else:
            run.damping *= 100.0
            run.failures += 1
            run.width *= 0.4
            run.done = run.failures > 2


def _distinct_steps(run: _Run, settings: FitSettings) -> list[tuple[float, np.ndarray]]:
    """Dampings and where they lead, less those that by the Jacobian lead where one before does."""
    assert run.jacobian is not None
    j = run.jacobian.reshape(-1, len(run.knobs))
    kept: list[tuple[float, np.ndarray]] = []
    moves: list[np.ndarray] = []
    for factor in settings.least_squares.dampings:
        x = _step(run, run.damping * factor)
        move = j @ (x - run.x)
        if all(np.linalg.norm(move - m) > settings.least_squares.alike * np.linalg.norm(m) for m in moves):
            kept.append((run.damping * factor, x))
            moves.append(move)
    return kept


def _scan(run: _Run) -> list[np.ndarray]:
    """Each threshold a little lower and higher than it is."""
    out = []
    for i, knob in enumerate(run.knobs):
        if knob.effect == TUNE or not BY_NAME[knob.effect].parameter(knob.parameter).threshold:
            continue
        if run.fresh is not None and knob not in run.fresh:
            continue
        for factor in (1.0 - run.width, 1.0 - 0.4 * run.width, 1.0 + 0.4 * run.width, 1.0 + run.width):
            x = run.x.copy()
            x[i] = np.clip(x[i] * factor, run.low[i], run.high[i])
            out.append(x)
    return out


def _step(run: _Run, damping: float) -> np.ndarray:
    assert run.jacobian is not None
    j = run.jacobian.reshape(-1, len(run.knobs))
    gradient = j.T @ run.r.ravel()
    free = ~(((run.x <= run.low) & (gradient > 0)) | ((run.x >= run.high) & (gradient < 0)))
    hessian = j.T @ j
    x = run.x.copy()
    if free.any():
        h = hessian[np.ix_(free, free)]
        d = np.maximum(np.diag(h), 1e-9 * max(float(np.diag(hessian).max()), 1e-12))
        x[free] -= np.linalg.lstsq(h + damping * np.diag(d), gradient[free], rcond=None)[0]
    # a trust region of a few scales keeps a nearly flat direction from running away
    farthest = np.where(run.logarithmic, FARTHEST, 20.0)
    return np.clip(run.x + np.clip(x - run.x, -farthest, farthest), run.low, run.high)


def _finish(run: _Run) -> Fit:
    assert run.jacobian is not None
    terms = tuple(dict.fromkeys(k.term for k in run.knobs if k.effect != TUNE))
    held = (run.x <= run.low + 1e-9) | (run.x >= run.high - 1e-9)
    return Fit(terms, run.knobs, run.values(run.x), run.local_scale(), run.cost, run.r, run.jacobian, held, run.fresh)


def on_problem(problem: Problem, fit: Fit, settings: FitSettings) -> Fit:
    """The same values judged on another problem (other windows or weights), without refitting."""
    again = _begin(problem, fit.values, problem.residuals([fit.values])[0], settings=settings)
    _derive(problem, [again], settings=settings)
    return replace(_finish(again), terms=fit.terms)
