"""Where a rippling torque is worth a fit: the waves of a joint's angle that what is left has in it.

A number of cycles is found by regression, not by replays: the torque that the model lacks shows through its response to
a kick, so that all numbers of cycles cost one replay per joint, once in a search.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.diagnosis.laws.settings import RippleSettings
from residual_mpc.diagnosis.predict.problem import Problem
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.remainder.coordinates import rate
from residual_mpc.diagnosis.remainder.dependence import folds_within
from residual_mpc.diagnosis.remainder.description import evenly_spread
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate, instants, kicks, response_of, tempered
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.effects.surroundings import TORQUE_RIPPLE
from residual_mpc.models.settings import Knob, Term, Values

TURN = 2.0 * np.pi  # rad
RIDGE = 1e-6  # relative


@dataclass(frozen=True)
class Wave:
    """acceleration rad/s^2 times sin(cycles q + phase); share: of what is left beyond the noise that it predicts on
    windows that it was not fitted to."""

    acceleration: float
    cycles: float
    phase: float
    share: float


@dataclass(frozen=True, eq=False)
class RippleFinder:
    """Suggests ripples on the windows of one search. scales: of its windows' motion."""

    data: Dataset
    space: Space
    scales: Scales
    tuning: RemainderSettings
    settings: RippleSettings

    def __call__(self, problem: Problem, fit: Fit) -> Mapping[Term, tuple[Values, ...]]:
        """Where to start from, by term; none where what this fit leaves has no wave of an angle in it. problem: on the
        finder's windows, whatever their steps."""
        return self.starts(problem.data.y, problem.replays([fit.values])[0]) if self._terms else {}

    def starts(self, y: np.ndarray, predicted: np.ndarray) -> Mapping[Term, tuple[Values, ...]]:
        """As the call, from what was measured and predicted (W, M, C) on all windows."""
        y, predicted = y[self._keep], predicted[self._keep]
        found = {term: self._waves(term, y, predicted) for term in self._terms}
        ranked = sorted((t for t in found if found[t]), key=lambda t: -found[t][0].share)
        return {t: tuple(self._start(t, w) for w in found[t]) for t in ranked[: self.settings.joints]}

    @cached_property
    def _terms(self) -> dict[Term, str]:
        """The candidates whose joint is measured and moves, with its channel."""
        out = {}
        for term in self.space.candidates:
            if term.effect == TORQUE_RIPPLE.name:
                joint = self.space.slots[term.effect][0] if term.target is None else term.target
                channel = f"position.{joint}"
                if channel in self.data.channels and not self.scales.still[self.data.channels.index(channel)]:
                    out[term] = channel
        return out

    @cached_property
    def _keep(self) -> np.ndarray:
        return evenly_spread(self.data.count, self.settings.windows)

    @cached_property
    def _few(self) -> Dataset:
        return self.data.take(self._keep)

    @cached_property
    def _kicks(self) -> Mapping[str, tuple[np.ndarray, str]]:
        """Of the model alone: effects change its response little, and a replay with them may cost far more."""
        nominal: Values = {k: self.space.null(k) for k in self.space.tunables}
        return kicks(self._few, self.space.settings([nominal]), self.scales, tuning=self.tuning)

    def _waves(self, term: Term, y: np.ndarray, predicted: np.ndarray) -> list[Wave]:
        """y, predicted (W, M, C)."""
        few, channel = self._few, self._terms[term]
        k = few.channels.index(channel)
        size = self.scales.s[k]
        error = np.where(few.compared[:, None, k], (y - predicted)[..., k], np.nan) / size
        at, used = instants(np.isfinite(error), settings=self.tuning)
        shown = np.where(used[:, None], np.take_along_axis(error, at, axis=1), 0.0)
        noise = self.settings.noise * (few.sigma[k] / size) ** 2
        if not used.any() or float(np.mean(shown[used] ** 2)) <= noise or channel not in self._kicks:
            return []
        response, unit = response_of(few, channel, self._kicks, at)
        used = used & np.isfinite(response).all(axis=(1, 2))
        missed = MissingRate(channel, unit, shown, noise, np.nan_to_num(response) / size, used)
        seen = np.where(np.isfinite(y[..., k]), y[..., k], np.nan_to_num(predicted[..., k]))
        speed = rate(np.nan_to_num(predicted[..., k]), few.t)
        knob = Knob(term.effect, term.target, "cycles")
        low, high = self.space.bounds(knob)
        step = 0.5 * np.pi / max(self.space.turned(knob), 1e-3)
        cycles = np.linspace(low, high, int(min(self.settings.most, np.ceil((high - low) / step) + 1)))
        folds = folds_within(few, settings=self.tuning)
        return waves(tempered(missed, settings=self.tuning), seen, speed, folds, cycles, self.settings)

    def _start(self, term: Term, wave: Wave) -> Values:
        inertia = self.space.robot.reference("inertia", term.target or self.space.slots[term.effect][0])
        numbers = {"amplitude": wave.acceleration * inertia, "cycles": wave.cycles, "phase": wave.phase}
        return {Knob(term.effect, term.target, name): value for name, value in numbers.items()}


def waves(
    m: MissingRate, z: np.ndarray, speed: np.ndarray, folds: np.ndarray, cycles: np.ndarray, settings: RippleSettings
) -> list[Wave]:
    """The waves that predict most on folds (W,) of windows that they were not fitted to, beside smooth functions of the
    position z (W, M) and the speed (W, M), the best first; none below what is worth a fit. cycles (N,): that are
    tried."""
    centre, wide = float(np.mean(z)), max(float(np.ptp(np.quantile(z, (0.02, 0.98)))), 1e-9)
    x = 2.0 * (z - centre) / wide
    usual = 0.1 * float(np.quantile(np.abs(speed), 0.9)) + 1e-9
    # a cubic would take up most of a single cycle
    smooth = _through(m, np.stack([np.ones_like(x), x, x**2, speed, np.tanh(speed / usual)], axis=-1))
    gains, numbers = np.zeros(len(cycles)), np.zeros((len(cycles), 2))
    whole, plain = float(np.sum(m.error[m.used] ** 2)), 0.0
    for part in np.array_split(np.arange(len(cycles)), max(1, len(cycles) // settings.at_once)):
        angle = z[..., None] * cycles[part]
        both = np.concatenate([_through(m, np.cos(angle)), _through(m, np.sin(angle))], axis=-1)
        pairs = both.reshape(*both.shape[:2], 2, len(part)).transpose(3, 0, 1, 2)  # (N, W, I, 2)
        plain, gains[part], numbers[part] = _gains(m, smooth, pairs, folds)
    left = whole - plain - m.noise * m.error[m.used].size
    shares = (gains - plain) / max(left, 1e-12)
    found: list[Wave] = []
    for i in np.argsort(-shares):
        apart = all(abs(cycles[i] - w.cycles) > 1.5 * TURN / wide for w in found)
        by_chance = gains[i] - plain < settings.chance * m.noise
        if by_chance or shares[i] < settings.worth or len(found) == settings.waves:
            break
        if apart:
            a, b = numbers[i]
            found.append(Wave(float(np.hypot(a, b)), float(cycles[i]), float(np.arctan2(a, b)), float(shares[i])))
    return found


def _through(m: MissingRate, columns: np.ndarray) -> np.ndarray:
    """(W, I, F) what missing rates (W, M, F) do to the channel."""
    return np.asarray(m.response @ columns) * m.used[:, None, None]


def _gains(
    m: MissingRate, smooth: np.ndarray, pairs: np.ndarray, folds: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Drop of the sum of squares on windows that were not fitted: of the smooth columns (W, I, S) alone, and (N,) with
    each pair (N, W, I, 2) beside them; (N, 2) the pairs' numbers in a fit to all windows."""
    s, n = smooth.shape[2], len(pairs)
    scale = np.sqrt(np.mean(smooth**2, axis=(0, 1))) + 1e-12
    sizes = np.sqrt(np.mean(pairs**2, axis=(1, 2))) + 1e-12  # (N, 2)
    base, pairs = smooth / scale, pairs / sizes[:, None, None, :]
    there = np.unique(folds)
    gram, cross = np.zeros((len(there), n, s + 2, s + 2)), np.zeros((len(there), n, s + 2))
    for f, fold in enumerate(there):
        b, p, e = base[folds == fold].reshape(-1, s), pairs[:, folds == fold].reshape(n, -1, 2), m.error[folds == fold]
        gram[f, :, :s, :s] = b.T @ b
        gram[f, :, :s, s:] = b.T @ p
        gram[f, :, s:, :s] = np.swapaxes(gram[f, :, :s, s:], 1, 2)
        gram[f, :, s:, s:] = np.swapaxes(p, 1, 2) @ p
        cross[f, :, :s] = b.T @ e.ravel()
        cross[f, :, s:] = np.swapaxes(p, 1, 2) @ e.ravel()
    ridge = RIDGE * base.shape[0] * base.shape[1]
    plain, gains = 0.0, np.zeros(n)
    for f in range(len(there)):
        other, seen = gram.sum(axis=0) - gram[f], cross.sum(axis=0) - cross[f]
        x = np.linalg.solve(other + ridge * np.eye(s + 2), seen[..., None])[..., 0]
        gains += 2.0 * np.sum(x * cross[f], axis=1) - np.einsum("na,nab,nb->n", x, gram[f], x)
        x0 = np.linalg.solve(other[0, :s, :s] + ridge * np.eye(s), seen[0, :s])
        plain += float(2.0 * x0 @ cross[f, 0, :s] - x0 @ gram[f, 0, :s, :s] @ x0)
    x = np.linalg.solve(gram.sum(axis=0) + ridge * np.eye(s + 2), cross.sum(axis=0)[..., None])[..., 0]
    return max(plain, 0.0), gains, x[:, s:] / sizes
