"""What no robot is without: small differences in every number of the library, which no one would call a cause.

Each number that a hypothesis does not free may lie off its null by `level` times its tolerance, normally distributed.
Together they add a covariance of low rank to the residuals (generalised least squares with random effects; Kennedy and
O'Hagan 2001, section 4, with the library in place of a Gaussian process). The level is the one under which the
residuals are most likely (type II maximum likelihood; MacKay 1992).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values


@dataclass(frozen=True, eq=False)
class Tolerances:
    """columns (W, M * C, K): how one tolerance of each number moves the prediction, channel units; level: how many
    tolerances the numbers are off; dispersion: of the residuals, whose cost counts in units of white noise."""

    columns: np.ndarray
    level: float
    dispersion: float = 1.0

    @property
    def relative(self) -> float:
        """The level beside residuals that hold `dispersion` times as much as white noise."""
        return float(self.level / np.sqrt(self.dispersion))


@dataclass(frozen=True, eq=False)
class Difference:
    """A hypothesis that is off in one number, `knob`, by `step`; own: that number and the others of its effect; values:
    these and those of the set it differs from."""

    knob: Knob
    step: float
    own: Mapping[Knob, float]
    values: Values

    def scaled(self, times: float) -> dict[Knob, float]:
        """The effect's own numbers where the one is off by so many steps."""
        return {**self.own, self.knob: self.own[self.knob] + (times - 1.0) * self.step}


def small_differences(
    space: Space, values: Values, free: tuple[Knob, ...] = (), *, settings: PredictSettings
) -> list[Difference]:
    """The hypotheses that differ from these values by one tolerance of one number, none of which is in `free`."""
    alone = {t.effect for t in space.candidates if t.target is not None}
    terms = (t for t in space.candidates if t.target is not None or t.effect not in alone)
    return [d for t in terms for d in _moved(space, t, values, free, settings=settings)]


def _moved(
    space: Space, term: Term, values: Values, free: tuple[Knob, ...], settings: PredictSettings
) -> list[Difference]:
    parameters = BY_NAME[term.effect].parameters
    knobs = {p.name: Knob(term.effect, term.target, p.name) for p in parameters}
    # if the effect is in the set for all targets alike, a single target's difference is taken from the common value
    everywhere = {knobs[p.name]: Knob(term.effect, None, p.name) for p in parameters}
    known = {knob: values.get(knob, values.get(common)) for knob, common in everywhere.items()}
    shapes = [p for p in parameters if p.shape]
    turns: list[Mapping[Knob, float]] = [{}]
    for p in shapes:
        own = known[knobs[p.name]]
        probes = (p.null,) if p.optional else p.probes[: settings.tolerances.shapes]
        several = dict.fromkeys(probes) if own is None else (own,)
        turns = [{**turn, knobs[p.name]: v} for turn in turns for v in several]
    out: list[Difference] = []
    for p in parameters:
        if p.shape or p.tolerance == 0.0:
            continue
        numbers = ((knobs[q.name], q.null) for q in parameters if not q.shape)
        rest = {k: null if (own := known[k]) is None else own for k, null in numbers}
        knob = knobs[p.name]
        if knob in free or everywhere[knob] in free:
            continue
        low, high = space.bounds(knob)
        step = p.tolerance * space.reference(knob)
        step = step if rest[knob] + step <= high else -step
        if low <= rest[knob] + step <= high:
            moved = {**rest, knob: rest[knob] + step}
            out += [Difference(knob, step, {**turn, **moved}, {**values, **turn, **moved}) for turn in turns]
    return out


def likeliest_level(
    gram: np.ndarray, score: np.ndarray, phi: float, settings: PredictSettings, share: float = 1.0
) -> float:
    """The level with the largest marginal likelihood, 0 where that is not clearly larger than without.

    gram (K, K): A'A of the whitened columns; score (K,): A'r of the residuals r; phi: their dispersion. share: of the
    windows that these come from; what they show in the likelihood grows with it, and so does what is clear.
    """
    tolerances = settings.tolerances
    g, v = np.linalg.eigh(gram)
    g, along = np.maximum(g, 0.0), (v.T @ score) ** 2
    parts = np.array(tolerances.levels)[:, None] ** 2 / phi
    likelihood = -0.5 * np.sum(np.log1p(parts * g) - parts * along / (phi * (1.0 + parts * g)), axis=1)
    best = int(np.argmax(likelihood))
    return tolerances.levels[best] if likelihood[best] > likelihood[0] + share * tolerances.beyond else 0.0
