"""Few numbers for an unknown function of a coordinate: hats between knots, a pair of waves, a number a run."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.remainder.coordinates import Coordinate
from residual_mpc.diagnosis.remainder.settings import RemainderSettings

# How the function of the coordinate enters: as it is, times the component's own speed, or times its direction.
FORMS = ("added", "speed", "direction")
MOTION = ("speed", "turning", "cornering", "direction")


def designs(
    c: Coordinate,
    form: str,
    component: str,
    run: np.ndarray,
    motion: Mapping[str, np.ndarray],
    settings: RemainderSettings,
) -> list[np.ndarray]:
    """The alternatives (W, M, F), of which the data choose one; empty where the form says nothing of this component.

    run (W,) indices; motion: each component's own speed (W, M).
    """
    if c.kind == "wheel_angle":
        return (
            _turning_wheel(c, run, settings=settings)
            if form == "speed" and len(np.unique(run)) <= settings.bases.phased_runs
            else []
        )
    if c.kind == "angle":
        return _toothed(c, settings=settings) if form == "added" and component == f"position.{c.of}" else []
    if c.kind == "lever":
        if form != "added" or component != f"position.{c.of}" or c.multiplier is None:
            return []
        return [b * c.multiplier[..., None] for b in _plain(c, run, settings=settings)]
    if form != "added" and (c.kind in MOTION or component not in motion):
        return []
    if form == "direction" and not component.startswith("position."):
        return []
    times = factor(form, motion.get(component))
    return [b * times[..., None] for b in _plain(c, run, settings=settings)]


def hats(z: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """(..., K) piecewise linear functions that are 1 at one knot each and 0 at the others, level beyond both ends."""
    eye = np.eye(len(knots))
    return np.stack([np.interp(z, knots, row) for row in eye], axis=-1)


def knots_of(z: np.ndarray, count: int, even: bool) -> np.ndarray:
    """At most `count` knots over z: evenly spread, or as many samples between each two."""
    low, high = np.quantile(z, (0.01, 0.99))
    if even:
        return np.linspace(low, high, count)
    inner = np.unique(np.quantile(z, np.linspace(0.01, 0.99, count)))
    apart = np.concatenate([[True], np.diff(inner) > 0.04 * max(high - low, 1e-12)])
    return np.asarray(inner[apart])


def factor(form: str, speed: np.ndarray | None) -> np.ndarray:
    """(W, M), or one number for all, that the function of the coordinate is multiplied by."""
    if form == "added" or speed is None:
        return np.ones(1) if speed is None else np.ones_like(speed)
    if form == "speed":
        return speed
    return np.tanh(speed / (0.1 * float(np.quantile(np.abs(speed), 0.9)) + 1e-9))


def _plain(c: Coordinate, run: np.ndarray, settings: RemainderSettings) -> list[np.ndarray]:
    if c.kind == "steady":
        return [np.ones((*c.z.shape, 1))]
    if c.kind == "direction":
        return [np.stack([np.ones_like(c.z), c.z], axis=-1)]
    if c.kind == "run":
        there = np.unique(run)
        return (
            [(c.z[..., None] == there).astype(float)] if len(run) >= settings.bases.windows_per_run * len(there) else []
        )
    if c.turn is not None:
        a = 2.0 * np.pi / c.turn * c.z
        return [np.stack([np.ones_like(a), np.cos(a), np.sin(a), np.cos(2.0 * a), np.sin(2.0 * a)], axis=-1)]
    knots = knots_of(c.z, settings.bases.knots, even=c.kind in ("time", "work", "order"))
    return [hats(c.z, knots)] if len(knots) > 1 else []


def tooth_counts(c: Coordinate, settings: RemainderSettings) -> tuple[int, ...]:
    """How often a turn something may repeat that this motion can show: it has to pass three quarters of a tooth."""
    low, high = np.quantile(c.z, (0.02, 0.98))
    return tuple(n for n in settings.bases.teeth if n * (high - low) > 1.5 * np.pi)


def _toothed(c: Coordinate, settings: RemainderSettings) -> list[np.ndarray]:
    one = np.ones_like(c.z)
    return [np.stack([one, np.cos(n * c.z), np.sin(n * c.z)], axis=-1) for n in tooth_counts(c, settings=settings)]


def _turning_wheel(c: Coordinate, run: np.ndarray, settings: RemainderSettings) -> list[np.ndarray]:
    """A wave over each turn, with a phase of its own in every run: where a wheel stood at the start is not known."""
    mine = (run[:, None] == np.unique(run)).astype(float)[:, None, :]
    speed = np.ones_like(c.z) if c.multiplier is None else c.multiplier
    out = []
    for s in settings.bases.stretch:
        waves = [(speed * f(s * c.z))[..., None] * mine for f in (np.cos, np.sin)]
        out.append(np.concatenate(waves, axis=-1))
    return out
