"""The shape of a dependence: the missing rate over the coordinate, between knots, with standard errors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.remainder.bases import designs, factor, hats, knots_of, tooth_counts
from residual_mpc.diagnosis.remainder.coordinates import Coordinate
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate
from residual_mpc.diagnosis.remainder.records import Curve
from residual_mpc.diagnosis.remainder.settings import RemainderSettings


@dataclass(frozen=True, eq=False)
class Fitted:
    """Which of the designs fits best on all windows, its numbers b (F,), and the error (W, I) that they predict."""

    which: int
    b: np.ndarray
    predicted: np.ndarray


def fitted(m: MissingRate, some: list[np.ndarray], settings: RemainderSettings) -> Fitted:
    """Least squares on all windows."""
    best, least = None, np.inf
    for k, design in enumerate(some):
        x = _through(m, design)
        b = _solve(np.einsum("wif,wig->fg", x, x), np.einsum("wif,wi->f", x, m.error), settings=settings)
        predicted = x @ b
        left = float(np.sum((m.error - predicted)[m.used] ** 2))
        if left < least:
            best, least = Fitted(k, b, predicted), left
    assert best is not None
    return best


def without(
    m: MissingRate,
    c: Coordinate,
    form: str,
    run: np.ndarray,
    motion: Mapping[str, np.ndarray],
    settings: RemainderSettings,
) -> MissingRate:
    """The component less what the coordinate explains of it."""
    some = designs(c, form, m.name, run, motion, settings=settings)
    return m if not some else replace(m, error=m.error - fitted(m, some, settings=settings).predicted)


def curve(
    m: MissingRate,
    c: Coordinate,
    form: str,
    run: np.ndarray,
    motion: Mapping[str, np.ndarray],
    settings: RemainderSettings,
) -> Curve:
    """The missing rate of one component over the coordinate, in the form that was chosen."""
    z, knots, repeats = _abscissa(m, c, form, run, motion, settings=settings)
    if c.kind == "wheel_angle" and c.multiplier is not None:
        times, y_unit = c.multiplier, "m/rad" if m.unit == "m/s" else "rad/rad"
    else:
        own = motion.get(m.name)
        times = factor(form, own)
        y_unit = m.unit if form != "speed" else {"rad/s^2": "1/s", "m/s^2": "1/s"}.get(m.unit, "1")
    columns = (z[..., None] == knots).astype(float) if c.kind in ("run", "direction") else _periodic(z, knots, repeats)
    x = _through(m, columns * times[..., None])
    keep = np.sum(x**2, axis=(0, 1)) > 1e-4 * np.max(np.sum(x**2, axis=(0, 1)))
    x, knots = x[..., keep], knots[keep]
    gram = np.einsum("wif,wig->fg", x, x)
    b = _solve(gram, np.einsum("wif,wi->f", x, m.error), settings=settings)
    score = np.einsum("wif,wi->wf", x, (m.error - x @ b) * m.used[:, None])  # a window's samples belong together
    inverse = np.linalg.inv(gram + settings.shape.ridge * np.trace(gram) * np.eye(len(gram)))
    se = np.sqrt(np.maximum(np.diag(inverse @ (score.T @ score) @ inverse), 0.0))
    points, rates, errors = (tuple(float(v) for v in a) for a in (knots, b, se))
    return Curve(m.name, points, rates, errors, c.unit, y_unit, repeats)


def _abscissa(
    m: MissingRate,
    c: Coordinate,
    form: str,
    run: np.ndarray,
    motion: Mapping[str, np.ndarray],
    settings: RemainderSettings,
) -> tuple[np.ndarray, np.ndarray, int | None]:
    """(W, M) the coordinate, folded where it repeats; its knots; and how often it repeats a turn."""
    shape = settings.shape
    if c.kind == "direction":
        return c.z, np.array([-1.0, 1.0]), None
    if c.kind == "run":
        return c.z, np.unique(c.z), None
    if c.turn is None:
        return c.z, knots_of(c.z, shape.knots, even=c.kind in ("time", "work", "order")), None
    z, repeats = c.z, 1
    if c.kind in ("angle", "wheel_angle"):
        some = designs(c, form, m.name, run, motion, settings=settings)
        best = fitted(m, some, settings=settings)
        if c.kind == "wheel_angle":
            z = _in_phase(c, best, run, settings=settings)
        else:
            repeats = tooth_counts(c, settings=settings)[best.which]
    period = c.turn / repeats
    return np.mod(z, period), np.arange(shape.knots) / shape.knots * period, repeats


def _in_phase(c: Coordinate, best: Fitted, run: np.ndarray, settings: RemainderSettings) -> np.ndarray:
    """The wheel's angle with each run's phase taken out."""
    there = np.unique(run)
    cos, sin = best.b[: len(there)], best.b[len(there) :]
    phase = np.arctan2(sin, cos)[np.searchsorted(there, run)]
    return np.asarray(settings.bases.stretch[best.which] * c.z - phase[:, None])


def _periodic(z: np.ndarray, knots: np.ndarray, repeats: int | None) -> np.ndarray:
    if repeats is None:
        return hats(z, knots)
    period = len(knots) * (knots[1] - knots[0])
    wide = hats(z, np.append(knots, period))
    wide[..., 0] += wide[..., -1]
    return np.asarray(wide[..., :-1])


def _through(m: MissingRate, design: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("wim,wmf->wif", m.response, design) * m.used[:, None, None])


def _solve(gram: np.ndarray, cross: np.ndarray, settings: RemainderSettings) -> np.ndarray:
    return np.asarray(np.linalg.solve(gram + settings.shape.ridge * np.trace(gram) * np.eye(len(gram)), cross))
