"""The remainder described: its components, where it sits, what it depends on and in which shape."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, per_window
from residual_mpc.diagnosis.data.where import locate
from residual_mpc.diagnosis.remainder.coordinates import KINDS, Coordinate, coordinates, load_coordinates, own_motion
from residual_mpc.diagnosis.remainder.dependence import Tried, try_all
from residual_mpc.diagnosis.remainder.loads import joint_loads
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate, missed_of, tempered
from residual_mpc.diagnosis.remainder.records import Component, Dependence, Resemblance, Rest
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.diagnosis.remainder.shape import curve, without
from residual_mpc.models.settings import Settings


def describe_remainder(
    data: Dataset,
    scales: Scales,
    settings: Settings,
    predicted: np.ndarray,
    error: np.ndarray,
    floors: np.ndarray,
    resemblance: Resemblance | None,
    rng: np.random.Generator,
    tuning: RemainderSettings,
) -> Rest:
    """predicted, error (W, M, C): of the model with all that is named (settings, one row); floors (draws, W, M, C):
    errors of a perfect one."""
    every = coordinates(data, predicted, settings=tuning)
    where = locate(data, scales, error, settings=tuning.data)
    burst = _half_within(per_window(data, scales, error))
    keep = evenly_spread(data.count, tuning.description.windows)
    few = data.take(keep)
    missed = missed_of(few, scales, settings, predicted[keep], error[keep], floors[:, keep], tuning=tuning)
    motion = {k: v[keep] for k, v in own_motion(data, predicted).items()}
    whole = sum(m.beyond for m in missed)
    asked = tuple(tempered(m, settings=tuning) for m in missed if m.beyond > tuning.description.small * whole)
    candidates = [*(_take(c, keep) for c in every), *load_coordinates(few, joint_loads(few, settings))]
    depends = _depends(few, asked, candidates, motion, rng, settings=tuning)
    return Rest(_components(missed), where, burst, depends, resemblance)


def _depends(
    data: Dataset,
    missed: Sequence[MissingRate],
    candidates: Sequence[Coordinate],
    motion: dict[str, np.ndarray],
    rng: np.random.Generator,
    settings: RemainderSettings,
) -> tuple[Dependence, ...]:
    """The first dependence, then what the rest of the rest depends on."""
    description = settings.description
    whole = sum(m.beyond for m in missed)
    found: list[Dependence] = []
    left = tuple(missed)
    while len(found) < description.named and sum(m.beyond for m in left) > (description.more if found else 0.0) * whole:
        part = sum(m.beyond for m in left) / whole
        tried = try_all(data, left, candidates, motion, rng, settings=settings)
        best = first_of(tried, description.worth / part, settings=settings)
        if best is None:
            break
        chosen, alike = best
        c = chosen.coordinate
        main = left[int(np.argmax(chosen.saved.sum(axis=1)))]
        found.append(
            Dependence(
                c.name, c.kind, c.of, chosen.form, min(chosen.share, 1.0) * part,
                float(chosen.by_chance.max()) * part, alike,
                curve(main, c, chosen.form, data.run, motion, settings=settings),
            )
        )  # fmt: skip
        left = tuple(without(m, c, chosen.form, data.run, motion, settings=settings) for m in left)
        candidates = [other for other in candidates if other is not c]
    return tuple(found)


def first_of(tried: Sequence[Tried], worth: float, settings: RemainderSettings) -> tuple[Tried, tuple[str, ...]] | None:
    """The dependence to name and the names of those that do as well; None where none is beyond chance.

    A share is beyond chance where it exceeds its coordinate's mean on shuffled windows by more than any coordinate did
    in any shuffle. A steady offset is the same however windows are shuffled: it is named where nothing else is.
    """
    good = beyond_chance(tried, worth)
    if not good:
        steady = [t for t in tried if t.coordinate.kind == "steady" and t.share >= worth]
        return (steady[0], ()) if steady else None
    best = good[0]
    close = [t for t in good if best.share - t.share < settings.description.alike]
    chosen = min(close, key=lambda t: (t.form != "added", KINDS.index(t.coordinate.kind)))
    alike = dict.fromkeys(t.coordinate.name for t in close if t.coordinate is not chosen.coordinate)
    return chosen, tuple(alike)


def beyond_chance(tried: Sequence[Tried], worth: float) -> list[Tried]:
    """Those that explain a share of at least `worth`, and more than chance would, in their order."""
    luck = max((float(np.max(t.by_chance - t.by_chance.mean())) for t in tried), default=0.0)
    return [t for t in tried if t.share >= worth and t.share - float(t.by_chance.mean()) > luck]


def _components(missed: Sequence[MissingRate]) -> tuple[Component, ...]:
    whole = max(sum(m.beyond for m in missed), 1e-12)
    out = []
    for m in missed:
        one = m.response.sum(axis=2)[m.used]  # to a rate of 1
        square = np.sum(one**2, axis=1)
        rates = np.sum(one * m.error[m.used], axis=1) / np.maximum(square, 1e-30)
        chance = m.noise / np.maximum(square, 1e-30)
        rate = float(np.sqrt(max(np.mean(rates**2 - chance), 0.0))) if len(rates) else 0.0
        out.append(Component(m.name, m.beyond / whole, rate, m.unit))
    return tuple(sorted(out, key=lambda c: -c.share))


def _half_within(square: np.ndarray) -> float:
    """The share of the windows that holds half of a sum of squares."""
    part = np.sort(square[np.isfinite(square)])[::-1]
    if not len(part) or not part.sum() > 0.0:
        return 1.0
    return float((np.searchsorted(np.cumsum(part), 0.5 * part.sum()) + 1) / len(part))


def evenly_spread(count: int, most: int) -> np.ndarray:
    """(count,) bool: at most so many, evenly spread."""
    keep = np.zeros(count, dtype=bool)
    keep[np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))] = True
    return keep


def _take(c: Coordinate, keep: np.ndarray) -> Coordinate:
    return replace(c, z=c.z[keep], multiplier=None if c.multiplier is None else c.multiplier[keep])
