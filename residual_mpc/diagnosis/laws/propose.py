"""Which laws are worth a fit: from what the remainder depends on beyond chance, on windows that fits may see."""

from collections.abc import Mapping, Sequence

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, per_window
from residual_mpc.diagnosis.laws.columns import of_columns
from residual_mpc.diagnosis.laws.proposal import Proposal, proposal
from residual_mpc.diagnosis.laws.ripples import RippleFinder
from residual_mpc.diagnosis.laws.settings import LawSettings
from residual_mpc.diagnosis.laws.shapes import Shape, best_shape, richer
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.diagnosis.remainder.bases import factor, tooth_counts
from residual_mpc.diagnosis.remainder.coordinates import (
    Coordinate,
    coordinates,
    lever_coordinates,
    load_coordinates,
    own_motion,
)
from residual_mpc.diagnosis.remainder.dependence import Tried, folds_across, try_all
from residual_mpc.diagnosis.remainder.description import beyond_chance, evenly_spread
from residual_mpc.diagnosis.remainder.loads import joint_loads
from residual_mpc.diagnosis.remainder.missing_rates import MissingRate, missed_of, tempered
from residual_mpc.diagnosis.remainder.settings import RemainderSettings
from residual_mpc.effects.laws import CARRIERS, KINDS, LawKind
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Term, Values

BY_KIND: Mapping[tuple[str, str, str], LawKind] = {(k.of, k.on, k.shape): k for k in KINDS}


def propose(
    data: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, tuning: RemainderSettings,
    settings: LawSettings,
) -> tuple[Proposal, ...]:  # fmt: skip
    """The laws of the quantities on which what the model (settings, one row) leaves depends, the most telling first."""
    hosts = (*(k.name for k in KINDS), *(c.effect for c in CARRIERS.values()))
    if not any(data.blocks[0].robot.slots(effect) for effect in hosts):
        return ()
    few = data.take(evenly_spread(data.count, settings.windows))
    predicted = predict(few, row)[0]
    error, floors = few.y - predicted, noise_errors(few, row, rng, settings.floor_draws)
    noise = np.mean([np.nanmean(per_window(few, scales, e)) for e in floors])
    if np.nanmean(per_window(few, scales, error)) <= tuning.predict.floor.margin**2 * noise:
        return ()
    missed = missed_of(few, scales, row, predicted, error, floors, tuning=tuning)
    whole = sum(m.beyond for m in missed)
    asked = [tempered(m, settings=tuning) for m in missed if m.beyond > tuning.description.small * whole]
    if not asked or whole <= 0.0:
        return ()
    motion = own_motion(few, predicted)
    loads = joint_loads(few, row)
    by_load = (*load_coordinates(few, loads), *lever_coordinates(few, predicted, loads))
    known = (*coordinates(few, predicted, settings=tuning), *by_load)
    every = [c for c in known if c.kind in SUPPORTED]
    tried = beyond_chance(try_all(few, asked, every, motion, rng, settings=tuning), tuning.description.worth)
    out: dict[Term, Proposal] = {}
    for t in tried:
        for kind, target, m in _hosts(t, asked, few.blocks[0].robot, settings):
            if len(out) < settings.tried and Term(kind.name, target) not in out:
                shapes = _shapes(kind, m, t.coordinate, few, motion, tuning, settings)
                if shapes:
                    out[Term(kind.name, target)] = proposal(kind, target, shapes[0], shapes[1:])
    return (*of_columns(few, max(asked, key=lambda m: m.beyond).name, settings), *out.values())


def ripples(
    data: Dataset, scales: Scales, space: Space, values: Values, tuning: RemainderSettings, settings: LawSettings
) -> tuple[Proposal, ...]:  # fmt: skip
    """The rippling torques that what these values leave has in it, the most telling of each joint."""
    finder = RippleFinder(data, space, scales, tuning, settings.ripples)
    found = finder.starts(data.y, predict(data, space.settings([values]))[0])
    return tuple(Proposal(term, "harmonic", {}, starts[0]) for term, starts in found.items())


# what a dependence (kind of the coordinate, form) of a joint's motion may be a law of
JOINT_LAWS: Mapping[tuple[str, str], tuple[tuple[str, str, str], ...]] = {
    ("angle", "added"): (("torque", "position", "wave"),),
    ("position", "added"): (("torque", "position", "curve"),),
    ("position", "direction"): (("friction", "position", "curve"),),
    ("position", "speed"): (("friction", "position", "curve"),),
    ("speed", "added"): (("torque", "speed", "curve"),),
    ("direction", "added"): (("torque", "speed", "curve"),),
    ("command", "added"): (("torque", "command", "curve"),),
    ("load", "added"): (("strength", "load", "curve"),),
    ("lever", "added"): (("strength", "position", "curve"),),
    ("time", "added"): (("torque", "time", "curve"),),
    ("time", "direction"): (("friction", "time", "curve"),),
    ("time", "speed"): (("friction", "time", "curve"),),
}
BASE_LAWS: Mapping[tuple[str, str], tuple[tuple[str, str, str], ...]] = {
    ("speed", "added"): (("rate", "forward", "curve"),),
    ("turning", "added"): (("rate", "turning", "curve"),),
    ("time", "speed"): (("strength", "time", "curve"),),
    ("time", "added"): (("strength", "time", "curve"),),
}
SUPPORTED = {kind for kind, _ in (*JOINT_LAWS, *BASE_LAWS)} | {"steady"}


def _hosts(
    t: Tried, asked: Sequence[MissingRate], robot: Robot, settings: LawSettings
) -> list[tuple[LawKind, str | None, MissingRate]]:
    """The laws that a dependence may be, each with its target and the component that shows its shape."""
    gains = t.saved.sum(axis=1)
    order = [k for k in np.argsort(-gains) if gains[k] > settings.other_target * gains.max()]
    by_name = {m.name: m for m in asked}
    main = asked[int(order[0])]
    if not main.name.startswith("position."):
        kinds = BASE_LAWS.get((t.coordinate.kind, t.form), ()) if t.coordinate.of is None else ()
        out = [(BY_KIND[k], None if k[0] == "strength" else main.name, main) for k in kinds]
    else:
        kinds = JOINT_LAWS.get((t.coordinate.kind, t.form), ())
        joints = [asked[int(k)].name.removeprefix("position.") for k in order]
        if t.coordinate.kind == "command":
            actuators = dict(zip(robot.actuators, optional.actuator_joints(robot), strict=True))
            joints = [actuators[str(t.coordinate.of)]]
        elif t.coordinate.of is not None:
            joints = [t.coordinate.of]
        out = [(BY_KIND[k], j, by_name.get(f"position.{j}", main)) for k in kinds for j in joints]
    return [(k, target, m) for k, target, m in out if _there(robot, k, target)]


def _there(robot: Robot, kind: LawKind, target: str | None) -> bool:
    slots = robot.slots(kind.name)
    return bool(slots) and (target is None or target in slots)


def _shapes(
    kind: LawKind, m: MissingRate, c: Coordinate, data: Dataset, motion: Mapping[str, np.ndarray],
    tuning: RemainderSettings, settings: LawSettings,
) -> tuple[Shape, ...]:  # fmt: skip
    """The simplest shape that does nearly as well as any, and richer ones over the same quantity; none where none
    predicts anything."""
    z, times = c.z, np.ones_like(c.z)
    if c.kind == "direction":
        z = motion[f"position.{c.of}"]
    if kind.of == "friction":
        times = -factor("direction", motion[m.name])
    elif kind.on == "load":
        z, times = np.abs(z), z
    elif c.kind == "lever" and c.multiplier is not None:
        times = c.multiplier
    elif kind.of == "strength":
        times = motion[m.name]
    turns = tooth_counts(c, settings=tuning) if kind.shape == "wave" else ()
    best = best_shape(kind, m, z, times, folds_across(data, settings=tuning), turns, settings)
    return () if best is None else (best, *richer(kind, best, z[np.isfinite(data.t)], settings))
