"""Whether two sets of runs differ in an effect by more than stretches of one set differ among themselves.

For every hypothesis each unit (a run, or a stretch of one) gives an estimate of its own, one Gauss-Newton step from the
account. Units, not samples, are the observations of the test between the sets, which therefore holds however coloured
the residuals are and however much the robot differs from run to run (Moulton 1990; Cameron and Miller 2015, section
VI).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from residual_mpc.comparison.permutation import permuted
from residual_mpc.comparison.settings import ContrastSettings
from residual_mpc.comparison.space import compose
from residual_mpc.comparison.units import Units
from residual_mpc.diagnosis.fit.evidence import dispersion
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 48  # hypotheses replayed at once: bounds the memory
DIFFERS = 0.3  # typical steps by which a number of the account differs from unit to unit


@dataclass(frozen=True)
class Contrast:
    """One probe of one hypothesis. before, dose: by which the probe is to be multiplied in what acts on both sets, and
    in the change; drop: in cost, that this promises; z, p: the standardised statistic and the probability that any of
    the hypotheses is as far off by chance; visible: the dose that would be found in at least four cases of five."""

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
        """Probability that this hypothesis alone is as far off by chance."""
        return float(2.0 * ndtr(-abs(self.z)))


@dataclass(frozen=True)
class Contrasts:
    """told: of each probe, in the order given; scatter_p: probability that the sizes of what the fit leaves of the
    units differ by chance as much between the sets: a change that no effect of the library describes shows there, even
    where it has no direction. All are corrected for all of them together."""

    told: tuple[Contrast, ...]
    scatter_p: float

    @property
    def p(self) -> float:
        """Probability that the sets differ by chance as much in anything that is tested."""
        return min([self.scatter_p, *(c.p for c in self.told)])


def contrasts(
    problem: Problem,
    current: Fit,
    units: Units,
    probes: Sequence[tuple[Term, Values]],
    settings: ContrastSettings,
) -> Contrasts:
    """The contrasts of these probes, each of which holds knobs of a change, with a fit."""
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
            # whether or not the account's numbers differ from unit to unit: nobody knows, so both are tried
            for products in ((size, score), own.without(term, along, size, score)):
                sizes.append(products[0])
                scores.append(products[1])
    logs, there = _scatter(current, units)
    size, score = np.array([*sizes, there]).T, np.array([*scores, -logs * there]).T
    found = permuted(size, score, units, settings)
    information = [size[side].sum(axis=0) for side in (~units.later, units.later)]
    drop = found.dose**2 * information[0] * information[1] / np.maximum(sum(information), 1e-300)
    told = []
    for i, (term, probe) in enumerate(probes):
        k = 2 * i + int(found.p[2 * i + 1] < found.p[2 * i])
        numbers = (x[k] for x in (found.before, found.dose, drop, found.z, found.p, found.visible))
        told.append(Contrast(term, probe, *(float(n) for n in numbers)))
    return Contrasts(tuple(told), float(found.p[-1]))


def _scatter(fit: Fit, units: Units) -> tuple[np.ndarray, np.ndarray]:
    """(U,) logarithm of the mean square that the fit leaves of each unit, and (U,) 1 where it has samples."""
    samples = units.summed(np.count_nonzero(fit.r, axis=1).astype(float))
    squares = units.summed(fit.per_window)
    return np.log(np.maximum(squares, 1e-12) / np.maximum(samples, 1.0)), (samples > 0.0).astype(float)


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
