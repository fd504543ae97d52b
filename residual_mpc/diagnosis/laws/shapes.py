"""The shape of a law: of several closed forms and a curve, the simplest that does as well where it was not fitted."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.remainder.bases import knots_of
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate
from residual_mpc.effects.laws import KNOTS, LEVELS, WAVE, LawKind, curve, curve_shape, wave
from residual_mpc.effects.ops import NUMPY

SIMPLEST = ("constant", "line", "bend", "step", "saturating", "harmonic", "curve")  # in this order
RIDGE = 1e-6  # relative: a shape has few numbers, and what it leaves is compared


@dataclass(frozen=True, eq=False)
class Shape:
    """form: one of SIMPLEST; fixed: the law's numbers that say how it acts; free: names of those that are fitted."""

    form: str
    fixed: Mapping[str, float]
    free: tuple[str, ...]

    def columns(self, kind: LawKind, z: np.ndarray) -> np.ndarray:
        """(..., F) what one unit of each free number adds at z."""
        null = {**dict.fromkeys(LEVELS if kind.shape == "curve" else WAVE, 0.0), **self.fixed}
        law = curve if kind.shape == "curve" else wave
        return np.stack([np.asarray(law(NUMPY, {**null, name: 1.0}, z)) for name in self.free], axis=-1)


def shapes_of(kind: LawKind, z: np.ndarray, settings: LawSettings, turns: tuple[int, ...]) -> list[Shape]:
    """Every shape that is tried over the values z of the quantity; turns: repetitions of a wave."""
    if kind.shape == "wave":
        return [Shape("harmonic", {"cycles": float(n)}, WAVE) for n in turns]
    low, high = (float(x) for x in np.quantile(z, (0.01, 0.99)))
    wide = max(high - low, 1e-9)
    out = [_curve("constant", [low]), _curve("line", [low, high])]
    inner = [*_zero(low, high), *np.unique(np.round(np.quantile(z, np.linspace(0.06, 0.94, settings.places)), 9))]
    for c in inner:
        for share in settings.widths:
            knots = [float(c) - 0.5 * share * wide, float(c) + 0.5 * share * wide]
            out.append(_curve("step" if share <= settings.widths[1] else "saturating", knots))
        if low + 0.02 * wide < c < high - 0.02 * wide:
            out.append(_curve("bend", [low, float(c), high]))
    for even in (True, False):
        knots = [float(k) for k in knots_of(z, settings.knots, even=even)]
        if len(knots) > 3:
            out.append(_curve("curve", knots))
    return out


def best_shape(
    kind: LawKind, m: MissingRate, z: np.ndarray, times: np.ndarray, folds: np.ndarray, turns: tuple[int, ...],
    settings: LawSettings,
) -> Shape | None:  # fmt: skip
    """The simplest shape that does nearly as well as the best one on folds (W,) of windows that it was not fitted to;
    None where none predicts anything. z (W, M): the quantity; times (W, M): what the law is multiplied by."""
    tried = [(_gain(m, s.columns(kind, z) * times[..., None], folds), s) for s in shapes_of(kind, z, settings, turns)]
    most = max((gain for gain, _ in tried), default=0.0)
    if most <= 0.0:
        return None
    least = most - settings.as_well * (float(np.sum(m.error[m.used] ** 2)) - most)
    good = [(gain, shape) for gain, shape in tried if gain >= least]
    return min(good, key=lambda g: (SIMPLEST.index(g[1].form), not _about_zero(g[1]), -g[0]))[1]


def richer(kind: LawKind, shape: Shape, z: np.ndarray, settings: LawSettings) -> tuple[Shape, ...]:
    """Shapes of more numbers over the values z of the quantity: a bend at the middle of their range, and a curve."""
    if kind.shape == "wave" or shape.form == "curve" or (shape.form == "constant" and kind.on != "load"):
        return ()
    low, high = (float(x) for x in np.quantile(z, (0.01, 0.99)))
    if not high > low:
        return ()
    knots = [float(k) for k in knots_of(z, settings.knots, even=True)]
    bend = [_curve("bend", [low, 0.5 * (low + high), high])] if len(shape.free) < 3 else []
    return (*bend, _curve("curve", knots))


def line(z: np.ndarray) -> Shape:
    """A straight line over the values z of the quantity, level beyond them."""
    return _curve("line", [float(x) for x in np.quantile(z, (0.01, 0.99))])


def _curve(form: str, knots: list[float]) -> Shape:
    return Shape(form, curve_shape(knots), LEVELS[: len(knots)])


def _about_zero(shape: Shape) -> bool:
    """Whether a bend or step lies at zero, as those of many laws do."""
    knots = [shape.fixed[name] for name in KNOTS[: len(shape.free)]] if "count" in shape.fixed else []
    return (len(knots) == 3 and knots[1] == 0.0) or (len(knots) == 2 and knots[0] == -knots[1])


def _zero(low: float, high: float) -> list[float]:
    """Where many laws change: at rest, or as the quantity changes its sign."""
    return [0.0] if low < 0.0 < high else []


def _gain(m: MissingRate, design: np.ndarray, folds: np.ndarray) -> float:
    """Drop of the sum of squares on windows that were not fitted. design (W, M, F)."""
    x = np.einsum("wim,wmf->wif", m.response, design, optimize=True) * m.used[:, None, None]
    x = x / (np.sqrt(np.mean(x**2, axis=(0, 1))) + 1e-12)
    gram, cross = np.einsum("wif,wig->wfg", x, x), np.einsum("wif,wi->wf", x, m.error)
    total, size = 0.0, RIDGE * len(x) * x.shape[1]
    for fold in np.unique(folds):
        test = folds == fold
        b = np.linalg.solve(gram[~test].sum(axis=0) + size * np.eye(x.shape[2]), cross[~test].sum(axis=0))
        total += float(2.0 * b @ cross[test].sum(axis=0) - b @ gram[test].sum(axis=0) @ b)
    return total
