"""Whether two sets of runs differ in an effect by more than stretches of one set differ among themselves.

For every hypothesis each unit (a run, or a stretch of one) gives an estimate of its own, one Gauss-Newton step from the
account. The two sets' means are compared by a t test in which units, not samples, are the observations. It therefore
holds however coloured the residuals are and however much the robot differs from run to run (Moulton 1990; Cameron and
Miller 2015, section VI). Bonferroni's factor corrects for the number of independent hypotheses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from residual_mpc.comparison.space import compose
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 48  # hypotheses replayed at once: bounds the memory
SAMPLED = 8_000  # numbers of a direction, of which correlations are measured
DIFFERS = 0.3  # typical steps by which a number of the account differs from unit to unit
FAINT = 1e-6  # of the unit that tells most, under which one tells nothing


@dataclass(frozen=True, eq=False)
class Units:
    """number (W,): which of the U units each window lies in; later (U,) bool: those of the later set; run (U,): the
    run that each is a stretch of; conditions (U, k): how each was driven, on which the model's errors may depend."""

    number: np.ndarray
    later: np.ndarray
    run: np.ndarray
    conditions: np.ndarray

    @property
    def count(self) -> int:
        return len(self.later)


@dataclass(frozen=True)
class Contrast:
    """One probe of one hypothesis. before, dose: by which the probe is to be multiplied in what acts on both sets, and
    in the change; drop: in cost, that this promises; t, p: Student's statistic and the probability that any of the
    hypotheses is as far off by chance."""

    term: Term
    probe: Values
    before: float
    dose: float
    drop: float
    t: float
    p: float


def build_units(
    number: np.ndarray, later_windows: np.ndarray, run_windows: np.ndarray, conditions: np.ndarray
) -> Units:
    """number (W,) of each window's unit, later_windows (W,) bool, run_windows (W,) its run, conditions (W, k) of it."""
    number = np.unique(number, return_inverse=True)[1]
    later = np.zeros(int(number.max()) + 1, dtype=bool)
    run = np.zeros(len(later), dtype=int)
    later[number], run[number] = later_windows, run_windows
    return Units(number, later, run, _averaged(conditions, number, len(later)))


def contrasts(problem: Problem, current: Fit, units: Units, probes: Sequence[tuple[Term, Values]]) -> list[Contrast]:
    """Each probe's contrast, in the order given, corrected for all of them; a probe holds knobs of a change."""
    j = current.jacobian
    own = _Known(
        _by_unit(np.einsum("wnp,wnq->wpq", j, j, optimize=True), units),
        _by_unit(np.einsum("wnp,wn->wp", j, current.r), units),
        tuple(k.term._replace(changed=False) for k in current.knobs),
        dispersion(current, units.number) / DIFFERS**2,
    )
    out: list[Contrast] = []
    directions: list[np.ndarray] = []
    for a in range(0, len(probes), ROWS):
        part = probes[a : a + ROWS]
        moved = problem.residuals([on_both(current.values, probe, problem.space) for _, probe in part])
        for (term, probe), r in zip(part, moved, strict=True):
            d = r - current.r
            directions.append(_short(d))
            size, score = (_by_unit(np.einsum("wn,wn->w", d, x), units) for x in (d, current.r))
            along = _by_unit(np.einsum("wn,wnp->wp", d, j, optimize=True), units)
            # whether or not the account's numbers differ from unit to unit: nobody knows, so both are tried
            either = [_tested(*products, units) for products in ((size, score), own.without(term, along, size, score))]
            before, dose, drop, t, p = min(either, key=lambda test: test[-1])
            out.append(Contrast(term, probe, before, dose, drop, t, p))
    many = 2.0 * effective_number(np.array(directions))
    return [replace(c, p=min(1.0, many * c.p)) for c in out]


def effective_number(directions: np.ndarray) -> float:
    """Of independent hypotheses among (N, n) directions, from the eigenvalues of their correlations (Li and Ji 2005,
    eq. 5): many effects do nearly the same."""
    if not len(directions):
        return 1.0
    size = np.linalg.norm(directions, axis=1)
    unit = directions[size > 0.0] / size[size > 0.0, None]
    values = np.abs(np.linalg.eigvalsh(unit @ unit.T)) if len(unit) else np.ones(1)
    return max(1.0, float(np.sum((values >= 1.0) + (values - np.floor(values)))))


def _short(direction: np.ndarray) -> np.ndarray:
    """A few thousand numbers of a direction, evenly."""
    flat = direction.ravel()
    return np.asarray(flat[:: max(1, len(flat) // SAMPLED)], dtype=np.float32)


def on_both(values: Values, probe: Values, space: Space) -> Values:
    """The values with the numbers of a change composed into what acts on both sets."""
    out = dict(values)
    for knob, change in probe.items():
        p = BY_NAME[knob.effect].parameter(knob.parameter)
        own = knob._replace(changed=False)
        before = out.get(own, out.get(Knob(knob.effect, None, knob.parameter)))
        value = change if before is None else compose(p, before, change)
        out[own] = float(np.clip(value, *space.bounds(own)))
    return out


@dataclass(frozen=True, eq=False)
class _Known:
    """Of the account's P numbers, by unit: products (U, P, P) of the derivatives with each other, (U, P) with the
    residuals; term of each; prior: dispersion over the variance with which a number differs from unit to unit."""

    products: np.ndarray
    scores: np.ndarray
    terms: tuple[Term, ...]
    prior: float

    def without(
        self, term: Term, along: np.ndarray, size: np.ndarray, score: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """A direction's products with itself and the residuals (U,), less what the account's other numbers explain of
        each unit, which differ a little from one to the next (random effects; Laird and Ware 1982, eq. 3.4)."""
        keep = np.array([t != term._replace(changed=False) for t in self.terms], dtype=bool)
        if not keep.any():
            return size, score
        h = along[:, keep]
        gram = self.products[:, keep][:, :, keep] + self.prior * np.eye(int(keep.sum()))
        taken = np.linalg.solve(gram, h[..., None])[..., 0]
        left = size - np.einsum("up,up->u", h, taken)
        return np.maximum(left, 0.0), score - np.einsum("up,up->u", taken, self.scores[:, keep])


def _by_unit(x: np.ndarray, units: Units) -> np.ndarray:
    """(U, ...) sums over the windows of each unit of x (W, ...)."""
    out = np.zeros((units.count, *x.shape[1:]))
    np.add.at(out, units.number, x)
    return out


def _tested(size: np.ndarray, score: np.ndarray, units: Units) -> tuple[float, float, float, float, float]:
    """Dose before, dose of the change, drop in cost, t and its p. size, score (U,): products of the direction with
    itself and with the residuals. What the account's other numbers take of a direction is the same in both sets, so
    that it leaves the difference alone."""
    seen = size > FAINT * size.max(initial=0.0)
    if not seen.any():
        return 0.0, 0.0, 0.0, 0.0, 1.0
    found, p = _at_both_levels(size, score, units)
    if found.freedom < 1.0:
        return found.before, found.dose, 0.0, 0.0, 1.0
    information = [float(size[side].sum()) for side in (~units.later, units.later)]
    drop = found.dose**2 * information[0] * information[1] / max(sum(information), 1e-300)
    return found.before, found.dose, drop, found.t, p


def scatter_p(fit: Fit, units: Units) -> float:
    """Probability that the sizes of what a fit leaves differ by chance as much between the sets: a change that no
    effect of the library describes shows there, even where it has no direction."""
    samples = _by_unit(np.count_nonzero(fit.r, axis=1).astype(float), units)
    squares = _by_unit(fit.per_window, units)
    size = (samples > 0.0).astype(float)
    return _at_both_levels(size, -np.log(np.maximum(squares, 1e-12) / np.maximum(samples, 1.0)) * size, units)[1]


def _at_both_levels(size: np.ndarray, score: np.ndarray, units: Units) -> "tuple[_Difference, float]":
    """The difference between the sets and its p; stretches are observations of their own unless their runs scatter by
    more than that explains."""
    by_stretch = _compared(size, score, units.later, units.conditions)
    at = np.unique(units.run, return_inverse=True)[1]
    runs = int(at.max()) + 1
    size_of, score_of = (np.bincount(at, x, minlength=runs) for x in (size, score))
    later = np.zeros(runs, dtype=bool)
    later[at] = units.later
    by_run = _compared(size_of, score_of, later, _averaged(units.conditions, at, runs))
    if by_run.variance > by_stretch.variance:
        by_stretch = replace(by_stretch, variance=by_run.variance, freedom=by_run.freedom)
    if by_stretch.freedom < 1.0:
        return by_stretch, 1.0
    return by_stretch, float(2.0 * stdtr(by_stretch.freedom, -abs(by_stretch.t)))


@dataclass(frozen=True)
class _Difference:
    """The mean estimate before, the difference after, its variance, and the degrees of freedom of that."""

    before: float
    dose: float
    variance: float
    freedom: float

    @property
    def t(self) -> float:
        return self.dose / float(np.sqrt(max(self.variance, 1e-300)))


def _compared(size: np.ndarray, score: np.ndarray, later: np.ndarray, conditions: np.ndarray) -> _Difference:
    """The two sets' mean estimates of units with these products (U,), given the conditions (U, k): weighted least
    squares on the set and the conditions (analysis of covariance; Cochran 1957)."""
    seen = size > FAINT * size.max(initial=0.0)
    estimate = np.where(seen, -score / np.where(seen, size, 1.0), 0.0)
    # a unit that tells much counts no more than twice one that tells as much as the middle one
    weight = np.where(seen, size / (size + np.median(size[seen])), 0.0)
    if not weight[later].any() or not weight[~later].any():
        return _Difference(0.0, 0.0, 0.0, 0.0)
    weight = weight / weight.mean()
    centred = conditions - weight @ conditions / weight.sum()
    x = np.column_stack([np.ones(len(later)), later, centred])
    inverse = np.linalg.pinv((x * weight[:, None]).T @ x, rcond=1e-9, hermitian=True)
    b = inverse @ (x.T @ (weight * estimate))
    counts = [float(w.sum() ** 2 / np.sum(w**2)) for w in (weight[~later], weight[later])]
    freedom = sum(counts) - np.linalg.matrix_rank(x)
    if min(counts) < 1.0 or freedom < 1.0:
        return _Difference(float(b[0]), float(b[1]), 0.0, 0.0)
    spread = float(weight @ (estimate - x @ b) ** 2 / weight.sum()) * sum(counts) / freedom
    spread *= len(later) / sum(counts)  # of units that weigh alike
    variance = spread * float((inverse @ ((x * weight[:, None] ** 2).T @ x) @ inverse)[1, 1]) * sum(counts) / len(later)
    return _Difference(float(b[0]), float(b[1]), variance, float(freedom))


def _averaged(conditions: np.ndarray, at: np.ndarray, count: int) -> np.ndarray:
    """(count, k) means of the conditions (n, k) over what `at` (n,) puts together."""
    total = np.zeros((count, conditions.shape[1]))
    np.add.at(total, at, conditions)
    return np.asarray(total / np.maximum(np.bincount(at, minlength=count), 1)[:, None])
