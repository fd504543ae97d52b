"""Whether two sets of runs differ in an effect by more than stretches of one set differ among themselves.

For every hypothesis each unit (a run, or a stretch of one) gives an estimate of its own, one Gauss-Newton step from the
account. The two sets' means are compared by a t test in which units, not samples,
are the observations, so that it holds however coloured the residuals are and however much the robot differs from run to
run (Moulton 1990; Cameron and Miller 2015, section VI). Bonferroni's factor corrects for how many
independent hypotheses there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr

from residual_mpc.comparison.space import compose
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 48  # hypotheses replayed at once: bounds the memory
SAMPLED = 8_000  # numbers of a direction, of which correlations are measured
FAINT = 1e-6  # of the unit that tells most, under which one tells nothing


@dataclass(frozen=True, eq=False)
class Units:
    """number (W,): which of the U units each window lies in; later (U,) bool: those of the later set; run (U,): the
    run that each is a stretch of."""

    number: np.ndarray
    later: np.ndarray
    run: np.ndarray

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


def build_units(number: np.ndarray, later_windows: np.ndarray, run_windows: np.ndarray) -> Units:
    """number (W,) of each window's unit, later_windows (W,) bool, run_windows (W,) its run."""
    number = np.unique(number, return_inverse=True)[1]
    later = np.zeros(int(number.max()) + 1, dtype=bool)
    run = np.zeros(len(later), dtype=int)
    later[number], run[number] = later_windows, run_windows
    return Units(number, later, run)


def contrasts(problem: Problem, current: Fit, units: Units, probes: Sequence[tuple[Term, Values]]) -> list[Contrast]:
    """Each probe's contrast, in the order given, corrected for all of them; a probe holds knobs of a change."""
    out: list[Contrast] = []
    directions: list[np.ndarray] = []
    for a in range(0, len(probes), ROWS):
        part = probes[a : a + ROWS]
        moved = problem.residuals([on_both(current.values, probe, problem.space) for _, probe in part])
        for (term, probe), r in zip(part, moved, strict=True):
            d = r - current.r
            directions.append(_short(d))
            size, score = (_by_unit(np.einsum("wn,wn->w", d, x), units) for x in (d, current.r))
            before, dose, drop, t, p = _tested(size, score, units)
            out.append(Contrast(term, probe, before, dose, drop, t, p))
    many = effective_number(np.array(directions))
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
    by_stretch = _Means.of(size, score, units.later)
    runs, at = np.unique(units.run, return_inverse=True)
    size_of, score_of = (np.bincount(at, x, minlength=len(runs)) for x in (size, score))
    later = np.zeros(len(runs), dtype=bool)
    later[at] = units.later
    by_run = _Means.of(size_of, score_of, later)
    # stretches are observations of their own unless their runs scatter more than that explains
    chosen = by_run if by_run.variance > by_stretch.variance else by_stretch
    if chosen.freedom < 1.0:
        return by_stretch.before, by_stretch.dose, 0.0, 0.0, 1.0
    information = [float(size[side].sum()) for side in (~units.later, units.later)]
    drop = by_stretch.dose**2 * information[0] * information[1] / max(sum(information), 1e-300)
    t = by_stretch.dose / float(np.sqrt(max(chosen.variance, 1e-300)))
    return by_stretch.before, by_stretch.dose, drop, t, float(2.0 * stdtr(chosen.freedom, -abs(t)))


@dataclass(frozen=True)
class _Means:
    """The mean estimate before, the difference after, its variance, and the degrees of freedom of that."""

    before: float
    dose: float
    variance: float
    freedom: float

    @staticmethod
    def of(size: np.ndarray, score: np.ndarray, later: np.ndarray) -> "_Means":
        """Of units with these products (U,); none is known from fewer than two a set."""
        seen = size > FAINT * size.max(initial=0.0)
        estimate = np.where(seen, -score / np.where(seen, size, 1.0), 0.0)
        # a unit that tells much counts no more than twice one that tells as much as the middle one
        weight = np.where(seen, size / (size + np.median(size[seen])), 0.0)
        means, counts, spread = [], [], 0.0
        for side in (~later, later):
            w, x = weight[side], estimate[side]
            if not w.any():
                return _Means(0.0, 0.0, 0.0, 0.0)
            n = float(w.sum() ** 2 / np.sum(w**2))
            mean = float(w @ x / w.sum())
            means.append(mean)
            counts.append(n)
            spread += n * float(w**2 @ (x - mean) ** 2 / np.sum(w**2))
        freedom = sum(counts) - 2.0
        if freedom < 1.0:
            return _Means(means[0], means[1] - means[0], 0.0, 0.0)
        variance = spread / freedom * (1.0 / counts[0] + 1.0 / counts[1])
        return _Means(means[0], means[1] - means[0], variance, freedom)
