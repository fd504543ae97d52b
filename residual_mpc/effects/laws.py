"""Laws that are fitted to what no named effect explains: a torque, a friction, a rate or a strength as a function of
one quantity.

Each is an effect like the others. A curve is linear between knots and level beyond the first and the last; a constant,
a line, a step, a saturation and a bend are curves of one, two or three knots. A wave has one harmonic of an angle.

A law of a logged column (a temperature, a supply voltage) changes the size of a named effect, its carrier, as a
function of the column's value at the start of a prediction. A log may have any columns, so these laws are built from
their names.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Literal

import numpy as np

from residual_mpc.effects.effect import Effect, Parameter, Reference, Site, Stage, TargetKind, Values, no_memory
from residual_mpc.effects.ops import NUMPY, Array, Kinks, Ops, clip

FITTED_LAW = "fitted_law"  # how a diagnosis names them all
MOST_KNOTS = 10
KNOTS = tuple(f"knot{i}" for i in range(1, MOST_KNOTS + 1))
LEVELS = ("start", *(f"rise{i}" for i in range(2, MOST_KNOTS + 1)))  # what is fitted of a curve
WAVE = ("offset", "cos", "sin")  # what is fitted of a wave
USUAL = "usual"  # value of the logged column on the runs that a law was fitted to
WAVE_POINTS = 13  # at which a wave is listed
NEAR = 1e-3  # rad, rad/s: over which a law's slope is taken
ROUNDED = 0.05  # of the stretch between two knots
INF = float("inf")

Of = Literal["torque", "friction", "damping", "rate", "strength"]
On = Literal["position", "speed", "command", "load", "time", "forward", "turning", "logged"]
UNITS: Mapping[On, str] = {
    "position": "rad", "speed": "rad/s", "command": "command unit", "load": "N m", "time": "s", "forward": "m/s",
    "turning": "rad/s", "logged": "",
}  # fmt: skip


@dataclass(frozen=True)
class LawKind:
    """of: what is missing; on: the quantity that it depends on; shape: of the function; column: of the log, where that
    is the quantity."""

    of: Of
    on: On
    shape: Literal["curve", "wave"]
    stage: Stage
    target: TargetKind
    site: Site
    unit: str  # of what is missing; "rate unit" where the target says it
    probe: float  # a value worth a first look, in units of the reference
    reference: Reference
    column: str = ""

    @property
    def name(self) -> str:
        """Of the effect."""
        if self.on == "logged":
            return f"{FITTED_LAW}_{self.of}_logged:{self.column}"
        return f"{FITTED_LAW}_{self.of}_{self.on}" + ("_wave" if self.shape == "wave" else "")

    @property
    def lever(self) -> bool:
        """Whether it is a share of the load on a joint that depends on the joint's position."""
        return self.of == "strength" and self.on == "position"

    @property
    def fitted(self) -> tuple[str, ...]:
        """The parameters that say how much; the others say how it acts and are fixed before they are fitted."""
        return LEVELS if self.shape == "curve" else WAVE


def curve(ops: Ops, p: Values, z: Array, stretches: int = MOST_KNOTS - 1) -> Array:
    """Linear between the knots, level beyond the first and the last: start + sum of rises, each between two knots.

    stretches: between knots, the first so many of which rise.
    """
    total = p["start"] + 0.0 * z
    for k, rise in enumerate(LEVELS[1 : stretches + 1]):
        if ops is NUMPY and not np.any(p[rise]):  # knots that no row uses
            continue
        low, high = p[KNOTS[k]], p[KNOTS[k + 1]]
        total = total + p[rise] * clip(ops, (z - low) / (high - low), 0.0, 1.0)
    return total


def wave(ops: Ops, p: Values, z: Array) -> Array:
    """offset + cos cos(n z) + sin sin(n z), with n repetitions a turn."""
    a = p["cycles"] * z
    return p["offset"] + p["cos"] * ops.cos(a) + p["sin"] * ops.sin(a)


def strength(ops: Ops, p: Values, memory: Any, y: Array, clock: Array, dt: float) -> tuple[Array, Any]:
    """(1 + curve(time since the run began)) y, never below zero."""
    return ops.maximum(1.0 + curve(ops, p, clock), 0.0) * y, memory


def load_strength(ops: Ops, p: Values, tau: Array, stretches: int = MOST_KNOTS - 1) -> Array:
    """curve(|tau|) tau, N m (N): added to the actuators' modelled torque tau at a joint. Where the curve falls, they
    weaken under load, like a motor whose supply voltage falls with the current.

    They never push backwards, and no more than twice as hard: a replay knows tau of the step before only, and a larger
    gain of that would run away.
    """
    size = ops.where(tau > 0.0, tau, -tau)  # times tau it is smooth as it is
    return clip(ops, curve(ops, p, size, stretches), -1.0, 1.0) * tau


def lever_strength(ops: Ops, p: Values, q: Array, tau: Array, stretches: int = MOST_KNOTS - 1) -> Array:
    """curve(position) tau, N m (N): added to the actuators' modelled torque tau at a joint. The lever arm of a linkage,
    a cam or a cable on an uneven drum changes with the position. Bounds as of `load_strength`.
    """
    return clip(ops, curve(ops, p, q, stretches), -1.0, 1.0) * tau


def curve_shape(knots: Sequence[float]) -> dict[str, float]:
    """The fixed parameters of a curve with these knots; those that are not used lie beyond the last and rise by 0."""
    spare = range(1, MOST_KNOTS - len(knots) + 1)
    places = [*map(float, knots), *(float(knots[-1]) + i for i in spare)]
    return {"count": float(len(knots)), **dict(zip(KNOTS, places, strict=True)),
            **dict.fromkeys(LEVELS[len(knots):], 0.0)}  # fmt: skip


def points_of(kind: LawKind, p: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """(knots, values): a curve's own points, or those of one repetition of a wave."""
    if kind.shape == "wave":
        z = np.linspace(0.0, 2.0 * np.pi / p["cycles"], WAVE_POINTS)
        return z, np.asarray(wave(NUMPY, p, z))
    count = int(p["count"])
    return np.array([p[k] for k in KNOTS[:count]]), np.cumsum([p[v] for v in LEVELS[:count]])


def shortened(kind: LawKind, p: Mapping[str, np.ndarray]) -> tuple[Values, Callable[..., Array]]:
    """Parameters and equation that give the same in numpy, without the stretches in which no row rises."""
    law = equation(kind)
    if kind.shape == "wave":
        return p, law
    return p, partial(law, stretches=stretches_of(p))


def stretches_of(p: Values) -> int:
    """Of a curve's stretches, the first so many hold all in which any row rises."""
    return max((k for k, name in enumerate(LEVELS) if np.any(p[name] != 0.0)), default=0)


def equation(kind: LawKind) -> Callable[..., Array]:
    """(ops, parameters, quantity) -> what a law on a joint or on the base's rates adds."""
    if kind.shape == "wave":
        return wave
    if kind.lever:
        return lever_strength
    return load_strength if kind.on == "load" else curve


def rounded(kinks: Kinks) -> Ops:
    """The operations of a law's equation: exact, or with its corners rounded over a part of each stretch."""
    return kinks.exact if kinks.width == 0.0 else kinks.rough(ROUNDED / kinks.width)


def slope(law: Callable[[Array], Array], z: Array, width: float) -> tuple[Array, Array]:
    """The value of a law at z and its slope, by central differences over `width` on both sides."""
    return law(z), (law(z + width) - law(z - width)) / (2.0 * width)


def _parameters(kind: LawKind) -> tuple[Parameter, ...]:
    sizes = tuple(Parameter(n, kind.unit, 0.0, -INF, INF, (kind.probe,), kind.reference) for n in kind.fitted)
    if kind.shape == "wave":
        return (Parameter("cycles", "1/turn", 1.0, 0.0, INF, (), shape=True), *sizes)
    unit = UNITS[kind.on]
    usual = (Parameter(USUAL, unit, 0.0, -INF, INF, (), shape=True),) if kind.on == "logged" else ()
    places = (Parameter(k, unit, float(i), -INF, INF, (), shape=True) for i, k in enumerate(KNOTS))
    return (Parameter("count", "1", 1.0, 1.0, MOST_KNOTS, (), shape=True), *usual, *places, *sizes)


def _effect(kind: LawKind) -> Effect:
    chained = kind.site == "strength" and kind.on != "logged"  # one of the chain from the command to the joint
    return Effect(
        name=kind.name,
        stage=kind.stage,
        port="output" if chained else "law",
        target=kind.target,
        parameters=_parameters(kind),
        summary=f"a {kind.of} that no named effect explains, as a function of one quantity",
        start=no_memory if chained else None,
        step=strength if chained else equation(kind),
        null_target=chained or kind.on == "logged",
        site=kind.site,
        not_in_mjcf="MJCF has no curves",
    )


KINDS: tuple[LawKind, ...] = (
    LawKind("strength", "time", "curve", "actuator", "actuator", "strength", "1", 0.05, "one"),
    LawKind("strength", "load", "curve", "actuator", "joint", "law", "1", 0.05, "one"),
    LawKind("strength", "position", "curve", "actuator", "joint", "law", "1", 0.05, "one"),
    LawKind("torque", "position", "wave", "body", "joint", "law", "N m", 0.1, "torque"),
    LawKind("torque", "position", "curve", "body", "joint", "law", "N m", 0.1, "torque"),
    LawKind("torque", "speed", "curve", "body", "joint", "law", "N m", 0.1, "torque"),
    LawKind("torque", "time", "curve", "body", "joint", "law", "N m", 0.1, "torque"),
    LawKind("torque", "command", "curve", "body", "joint", "law", "N m", 0.1, "torque"),
    LawKind("friction", "position", "curve", "body", "joint", "law friction", "N m", 0.1, "torque"),
    LawKind("friction", "time", "curve", "body", "joint", "law friction", "N m", 0.1, "torque"),
    LawKind("rate", "forward", "curve", "contact", "channel", "rate", "rate unit", 0.02, "one"),
    LawKind("rate", "turning", "curve", "contact", "channel", "rate", "rate unit", 0.02, "one"),
)  # fmt: skip
LISTED: Mapping[str, LawKind] = {kind.name: kind for kind in KINDS}
LOADED = next(kind.name for kind in KINDS if kind.on == "load")
LAWS: tuple[Effect, ...] = tuple(_effect(kind) for kind in KINDS)


@dataclass(frozen=True)
class Carrier:
    """The named effect whose parameter a law of a logged column sets. factor: the law c makes it (1 + c) times as
    large; otherwise c is added."""

    effect: str
    parameter: str
    factor: bool


CARRIERS: Mapping[Of, Carrier] = {
    "strength": Carrier("actuator_gain", "gain", True),
    "torque": Carrier("torque_offset", "torque", False),
    "friction": Carrier("coulomb_friction", "torque", False),
    "damping": Carrier("viscous_friction", "coefficient", False),
}
_LOGGED: Mapping[Of, tuple[Stage, TargetKind, Site, str, float, Reference]] = {
    "strength": ("actuator", "actuator", "strength", "1", 0.05, "one"),
    "torque": ("body", "joint", "elastic", "N m", 0.1, "torque"),
    "friction": ("body", "joint", "dry friction", "N m", 0.1, "torque"),
    "damping": ("body", "joint", "damping", "N m s/rad", 0.1, "torque/speed"),
}


def logged_kind(of: Of, column: str) -> LawKind:
    """The law of a logged column that sets the size of the carrier of `of`."""
    stage, target, site, unit, probe, reference = _LOGGED[of]
    return LawKind(of, "logged", "curve", stage, target, site, unit, probe, reference, column)


@cache
def kind_of(effect: str) -> LawKind | None:
    """The kind of a fitted law; None for any other effect."""
    start, _, column = effect.partition("_logged:")
    of = next((of for of in CARRIERS if start == f"{FITTED_LAW}_{of}"), None)
    return LISTED.get(effect) if of is None or not column else logged_kind(of, column)


@cache
def law_of_column(effect: str) -> Effect | None:
    """The law of a logged column of this name; None for any other name."""
    kind = kind_of(effect)
    return None if kind is None or kind.on != "logged" else _effect(kind)


def is_law(effect: str) -> bool:
    """Whether an effect is a fitted law."""
    return kind_of(effect) is not None


def published(effect: str) -> str:
    """The name of an effect in a diagnosis: all fitted laws have one."""
    return FITTED_LAW if is_law(effect) else effect


def quantities_of(effect: Effect) -> tuple[On, ...]:
    """What the torque or friction of an effect on a joint is a function of."""
    kind = kind_of(effect.name)
    if kind is None:
        return ("position", "speed")
    return ("position", "load") if kind.lever else (kind.on,)


def reads_clock(effect: Effect) -> bool:
    """Whether an effect on a joint or its actuator needs to know the time since the run began."""
    law = kind_of(effect.name)
    return (effect.place == "strength" and effect.timed) or (law is not None and law.on == "time")
