"""A fitted law as a diagnosis publishes it: its points with intervals, and the numbers of its closed form."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit.evidence import T95
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.effects.body import COULOMB
from residual_mpc.effects.laws import LawKind, kind_of, points_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models import optional
from residual_mpc.models.settings import TUNE, Knob, Term, Values

NEAR = 1e-6  # of a typical size, for difference quotients
CHOSEN = ("cycles", "at", "from", "to")
RATE_UNITS = {"forward": "m/s", "sideways": "m/s", "yaw": "rad/s"}


@dataclass(frozen=True)
class LawNumber:
    """A number of a closed form with its 95 % interval, None for one that was chosen among a few and not fitted."""

    value: float
    ci95: tuple[float, float] | None
    unit: str


@dataclass(frozen=True)
class FittedLaw:
    """of: what is missing ("torque", "friction", "rate", "strength"), in `unit`; on: the quantity in words, in
    `on_unit`; knots, values: linear between these points and level beyond the first and the last, save for the form
    "harmonic", of which they are one repetition; low, high: 95 % of the values; form: the shape; numbers: of its closed
    form, none for a "curve"."""

    of: str
    on: str
    form: str
    knots: tuple[float, ...]
    values: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    unit: str
    on_unit: str
    numbers: Mapping[str, LawNumber]

    def document(self) -> dict[str, object]:
        """What an entry of an explanation says of it, beside effect, target and probability."""
        return {
            "of": self.of,
            "on": self.on,
            "form": self.form,
            "unit": self.unit,
            "on_unit": self.on_unit,
            "knots": list(self.knots),
            "values": list(self.values),
            "values_ci95": [list(self.low), list(self.high)],
            "parameters": {
                name: {"value": n.value, "ci95": n.ci95 and list(n.ci95), "unit": n.unit}
                for name, n in self.numbers.items()
            },
        }


def fitted_law(
    space: Space, term: Term, form: str, values: Values, free: Sequence[Knob], spread: np.ndarray
) -> FittedLaw:
    """values: of the whole explanation; free: the law's fitted numbers, with their covariance (F, F)."""
    kind = _kind(term)
    whole = {k.parameter: v for k, v in space.whole(values).items() if k.term == term}
    unit, on_unit = units_of(space, term)

    def numbers_at(x: np.ndarray) -> np.ndarray:
        p = {**whole, **dict(zip((k.parameter for k in free), map(float, x), strict=True))}
        return np.array([*points_of(kind, p)[1], *_closed_form(kind, form, p).values()])

    at = np.array([values[k] for k in free])
    found = numbers_at(at)
    sizes = NEAR * np.array([space.scale(k) for k in free])
    slopes = np.stack([(numbers_at(at + e) - numbers_at(at - e)) / (2.0 * e.sum()) for e in np.diag(sizes)], axis=1)
    half = T95 * np.sqrt(np.maximum(np.einsum("if,fg,ig->i", slopes, spread, slopes), 0.0))
    knots = points_of(kind, whole)[0]
    n, names = len(knots), tuple(_closed_form(kind, form, whole))
    closed = {
        name: LawNumber(
            float(v), None if name in CHOSEN else (float(v - h), float(v + h)), _unit_of(name, unit, on_unit)
        )
        for name, v, h in zip(names, found[n:], half[n:], strict=True)
    }
    level, wide = found[:n], half[:n]
    points = (knots, level, level - wide, level + wide)
    least = _least_friction(space, term, values) if kind.of == "friction" else -np.inf
    if level.min() < least:  # the simulation clips a joint's friction at zero
        points, form, closed = _no_less_than(least, *points), "curve", {}
    z, middle, low, high = map(_tuple, points)
    return FittedLaw(kind.of, words_of(space, term), form, z, middle, low, high, unit, on_unit, closed)


def _least_friction(space: Space, term: Term, values: Values) -> float:
    """N m (N), the lowest value of a law of dry friction: minus the other dry friction of its joint. Minus infinity
    where that is not the same throughout the runs and known here."""
    slots = space.slots[term.effect] if term.target is None else (term.target,)
    own = {None, *slots}
    others = {k.term for k in values if k.effect != TUNE and k.term != term and k.target in own}
    varying = any(_rubs(t.effect) or BY_NAME[t.effect].place == "friction" for t in others)
    tuned = any(k.effect == TUNE and k.parameter.endswith(".frictionloss") for k in values)
    if len(slots) != 1 or varying or tuned:
        return -np.inf
    modelled = -space.bounds(Knob(COULOMB.name, slots[0], "torque"))[0]
    return 0.0 - modelled - sum(values.get(Knob(COULOMB.name, target, "torque"), 0.0) for target in own)


def _rubs(effect: str) -> bool:
    """Whether an effect is a fitted law of dry friction."""
    kind = kind_of(effect)
    return kind is not None and kind.of == "friction"


def _no_less_than(
    least: float, knots: np.ndarray, level: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A curve and its band, clipped at `least`, with further knots where they cross it."""
    z = [knots]
    for above in (y - least for y in (level, low, high)):
        i = np.flatnonzero(above[:-1] * above[1:] < 0.0)
        z.append(knots[i] + above[i] / (above[i] - above[i + 1]) * np.diff(knots)[i])
    every = np.unique(np.concatenate(z))
    clipped = (np.maximum(np.interp(every, knots, y), least) for y in (level, low, high))
    return (every, *clipped)


def words_of(space: Space, term: Term) -> str:
    """The quantity that a law is a function of, as the remainder's coordinates are called."""
    kind = _kind(term)
    if kind.on == "logged":
        return f"the logged {kind.column}"
    robot = {"time": "the time in the run", "forward": "the forward speed", "turning": "the turning rate"}
    if kind.on in robot:
        return robot[kind.on]
    if kind.on == "command":
        joints = optional.actuator_joints(space.robot)
        named = [a for a, j in zip(space.robot.actuators, joints, strict=True) if j == term.target]
        return f"the command of {named[0] if named else term.target}"
    if kind.on == "load":
        return f"the size of the load on {term.target}"
    return f"the {'angle' if kind.shape == 'wave' else kind.on} of {term.target}"


def units_of(space: Space, term: Term) -> tuple[str, str]:
    """Of what is missing, and of the quantity."""
    kind, robot = _kind(term), space.robot
    sliding = term.target in optional.sliding(robot)
    turn = "m" if sliding else "rad"
    unit = RATE_UNITS.get(str(term.target), "rad/s") if kind.of == "rate" else kind.unit
    unit = {"N m": "N", "N m s/rad": "N s/m"}.get(unit, unit) if sliding else unit
    if kind.on == "command":
        joints = optional.actuator_joints(robot)
        sent = [k for k, j in zip(robot.command_kinds, joints, strict=True) if j == term.target]
        return unit, {"position": turn, "torque": "N" if sliding else "N m"}.get(sent[0] if sent else "", f"{turn}/s")
    on = {
        "position": turn, "speed": f"{turn}/s", "load": "N" if sliding else "N m", "time": "s", "forward": "m/s",
        "turning": "rad/s", "logged": "",
    }  # fmt: skip
    return unit, on[kind.on]


def _kind(term: Term) -> LawKind:
    kind = kind_of(term.effect)
    assert kind is not None
    return kind


def _closed_form(kind: LawKind, form: str, p: Mapping[str, float]) -> dict[str, float]:
    """The numbers of a closed form; a harmonic is offset + amplitude sin(cycles z + phase)."""
    if form == "harmonic":
        return {
            "amplitude": float(np.hypot(p["cos"], p["sin"])),
            "cycles": p["cycles"],
            "phase": float(np.arctan2(p["cos"], p["sin"])),
            "offset": p["offset"],
        }
    z, y = points_of(kind, p)
    if form == "constant":
        return {"level": float(y[0])}
    if form == "line":
        gradient = float((y[1] - y[0]) / (z[1] - z[0]))
        return {"at_zero": float(y[0] - gradient * z[0]), "gradient": gradient}
    if form in ("step", "saturating"):
        ends = {"at": float(0.5 * (z[0] + z[1]))} if form == "step" else {"from": float(z[0]), "to": float(z[1])}
        return {"below": float(y[0]), "above": float(y[1]), **ends}
    if form == "bend":
        slopes = np.diff(y) / np.diff(z)
        below, above = map(float, slopes)
        return {"at": float(z[1]), "level": float(y[1]), "gradient_below": below, "gradient_above": above}
    return {}


def _unit_of(name: str, unit: str, on_unit: str) -> str:
    if name.startswith("gradient") and not on_unit:
        return f"{unit}/unit"
    if name.startswith("gradient"):
        return "1" if unit == on_unit else SLOPES.get((unit, on_unit), f"({unit})/({on_unit})")
    return {"cycles": "1/turn", "phase": "rad", "at": on_unit, "from": on_unit, "to": on_unit}.get(name, unit)


SLOPES = {
    ("N m", "rad"): "N m/rad", ("N m", "rad/s"): "N m s/rad", ("N m", "s"): "N m/s", ("1", "s"): "1/s",
    ("1", "rad"): "1/rad", ("1", "m"): "1/m", ("1", "N m"): "1/(N m)", ("1", "N"): "1/N", ("rad/s", "m/s"): "rad/m",
    ("m/s", "rad/s"): "m/rad", ("N", "m"): "N/m", ("N", "m/s"): "N s/m",
}  # fmt: skip


def _tuple(x: np.ndarray) -> tuple[float, ...]:
    return tuple(map(float, x))
