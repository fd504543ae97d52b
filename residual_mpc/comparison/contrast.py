"""Whether two sets of runs differ in an effect by more than the scatter within each set.

For every hypothesis, each unit (a run or a stretch of one) gives its own estimate, one Gauss-Newton step from the
account. Units, not samples, are the observations of the test, so neither coloured residuals nor differences of the
robot from run to run invalidate it (Moulton 1990; Cameron and Miller 2015, section VI).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from residual_mpc.comparison.permutation import permuted
from residual_mpc.comparison.run_divisions import combined, p_of_divisions, p_of_runs
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.space import compose
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 48  # hypotheses replayed at once, to limit memory use
LEAST_LEFT = 0.05  # share of a unit's squares that a hypothesis leaves at least
DIFFERS = 0.3  # typical steps: spread of a parameter of the account from unit to unit


@dataclass(frozen=True)
class Contrast:
    """One probe of one hypothesis. before, dose: factors of the probe in what acts on both sets and in the change;
    drop: predicted reduction of the cost; z: standardised statistic; p: probability that the largest |z| of all
    hypotheses is at least this large by chance; visible: minimum detectable dose, found in at least four cases of
    five."""

    term: Term
    probe: Values
    before: float
    dose: float
    drop: float
    z: float
    p: float
    visible: float

    @property
    def alone(self) -> float:
        """p of this hypothesis by itself, not corrected for the others."""
        return float(2.0 * ndtr(-abs(self.z)))


@dataclass(frozen=True)
class Contrasts:
    """told: one contrast per probe, in the order given; scatter_p: probability that the sizes of the units' residuals
    differ as much between the sets by chance. A change that no effect of the library describes shows there, even if it
    has no direction. Each p is corrected for all tests of its kind and for the share of the level that its kind has."""

    told: tuple[Contrast, ...]
    scatter_p: float

    @property
    def p(self) -> float:
        """Probability that any test shows as large a difference between the sets by chance."""
        return min([self.scatter_p, *(c.p for c in self.told)])


@dataclass(frozen=True, eq=False)
class Estimates:
    """What each of U units tells about N hypotheses. size, score (U, N): products of the hypothesis' direction with
    itself and with the residuals; misfit (U, N): mean square of the residuals that the unit's own estimate leaves.
    probes: two hypotheses each, and one more for the size of the residuals."""

    size: np.ndarray
    score: np.ndarray
    misfit: np.ndarray
    probes: tuple[tuple[Term, Values], ...]


def contrasts(
    problem: Problem,
    current: Fit,
    units: Units,
    probes: Sequence[tuple[Term, Values]],
    settings: ContrastSettings,
) -> Contrasts:
    """The contrasts of these probes against a fit. Each probe holds the knobs of a change."""
    return tested(estimates_of(problem, current, units, probes), units, settings)


def estimates_of(problem: Problem, current: Fit, units: Units, probes: Sequence[tuple[Term, Values]]) -> Estimates:
    """The estimates of each unit; which set a unit belongs to does not matter."""
    j = current.jacobian
    own = _Known(
        units.summed(np.einsum("wnp,wnq->wpq", j, j, optimize=True)),
        units.summed(np.einsum("wnp,wn->wp", j, current.r)),
        tuple(k.term._replace(changed=False) for k in current.knobs),
        dispersion(current, units.number) / DIFFERS**2,
    )
    sizes, scores = [], []
    for a in range(0, len(probes), ROWS):
        part = probes[a : a + ROWS]
        moved = problem.residuals([on_both(current.values, probe, problem.space) for _, probe in part])
        for (term, _), r in zip(part, moved, strict=True):
            d = r - current.r
            size, score = (units.summed(np.einsum("wn,wn->w", d, x)) for x in (d, current.r))
            along = units.summed(np.einsum("wn,wnp->wp", d, j, optimize=True))
            # it is not known whether the account's parameters vary from unit to unit, so both are tested
            for products in ((size, score), own.without(term, along, size, score)):
                sizes.append(products[0])
                scores.append(products[1])
    misfit = _misfit(
        np.array(sizes).reshape(-1, units.count), np.array(scores).reshape(-1, units.count), current, units
    )
    logs, there = _scatter(current, units)
    return Estimates(
        np.array([*sizes, there]).T,
        np.array([*scores, -logs * there]).T,
        np.vstack([misfit, np.ones(units.count)]).T,
        tuple(probes),
    )


def tested(of: Estimates, units: Units, settings: ContrastSettings) -> Contrasts:
    """Whether the estimates of the two sets differ by more than within each set: by the standardised differences, and,
    with few runs, by what a change explains in all their divisions as well; with enough divisions also by the
    differences in them. Of two tests the smaller p counts twice (Bonferroni)."""
    found = permuted(of.size, of.score, of.misfit, units, settings)
    information = [of.size[side].sum(axis=0) for side in (~units.later, units.later)]
    drop = found.dose**2 * information[0] * information[1] / np.maximum(sum(information), 1e-300)
    own = of.size[:, :-1], of.score[:, :-1], of.misfit[:, :-1]
    corrected = combined(np.minimum(found.p / (1.0 - settings.of_size), 1.0), p_of_divisions(*own, units, settings))
    exact = p_of_runs(found, units, settings)
    if exact is not None:  # which is none for the size of the residuals
        exact = np.append(exact, 1.0) / (1.0 - settings.of_size)
        corrected = np.minimum(2.0 * np.minimum(corrected, exact), 1.0)
    told = []
    for i, (term, probe) in enumerate(of.probes):
        k = 2 * i + int(found.p[2 * i + 1] < found.p[2 * i])
        numbers = (x[k] for x in (found.before, found.dose, drop, found.z, corrected, found.visible))
        told.append(Contrast(term, probe, *(float(n) for n in numbers)))
    return Contrasts(tuple(told), min(float(found.alone[-1]) / settings.of_size, 1.0))


def _misfit(size: np.ndarray, score: np.ndarray, fit: Fit, units: Units) -> np.ndarray:
    """(N, U) mean square of what each hypothesis leaves of a unit's residuals with the size that this unit alone tells;
    size, score (N, U). A unit in which the model misses much else tells little, however far the hypothesis moves it."""
    samples = units.summed(np.count_nonzero(fit.r, axis=1).astype(float))
    squares = units.summed(fit.per_window)
    taken = score**2 / np.where(size > 0.0, size, np.inf)
    return np.asarray(np.maximum(squares - taken, LEAST_LEFT * squares) / np.maximum(samples, 1.0))


def _scatter(fit: Fit, units: Units) -> tuple[np.ndarray, np.ndarray]:
    """(U,) logarithm of the mean squared residual of each unit; (U,) 1 for a unit with samples, else 0."""
    samples = units.summed(np.count_nonzero(fit.r, axis=1).astype(float))
    squares = units.summed(fit.per_window)
    return np.log(np.maximum(squares, 1e-12) / np.maximum(samples, 1.0)), (samples > 0.0).astype(float)


def on_both(values: Values, probe: Values, space: Space) -> Values:
    """The values with the parameters of a change combined into what acts on both sets."""
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
    """The P parameters of the account, by unit. products (U, P, P): of the derivatives with each other; scores (U, P):
    with the residuals; terms: one per parameter; prior: dispersion divided by the variance of a parameter from unit to
    unit."""

    products: np.ndarray
    scores: np.ndarray
    terms: tuple[Term, ...]
    prior: float

    def without(
        self, term: Term, along: np.ndarray, size: np.ndarray, score: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """A direction's products with itself and with the residuals, (U,) each, less the part that the account's other
        parameters explain if they vary from unit to unit (random effects; Laird and Ware 1982, eq. 3.4)."""
        keep = np.array([t != term._replace(changed=False) for t in self.terms], dtype=bool)
        if not keep.any():
            return size, score
        h = along[:, keep]
        gram = self.products[:, keep][:, :, keep] + self.prior * np.eye(int(keep.sum()))
        taken = np.linalg.solve(gram, h[..., None])[..., 0]
        left = size - np.einsum("up,up->u", h, taken)
        return np.maximum(left, 0.0), score - np.einsum("up,up->u", taken, self.scores[:, keep])
