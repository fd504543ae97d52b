"""All effects, in the order of the contract's table, which decides which of a confounded group is named; effects that
it does not list stand beside those of their kind, and after all others in `ORDER`. A user's own come last."""

from collections.abc import Iterator, Mapping
from operator import itemgetter
from typing import Any

from residual_mpc.effects import actuator, body, command, contact, drive, position_servo, sensor, surroundings
from residual_mpc.effects.effect import Effect, Quantity, Site, Values
from residual_mpc.effects.laws import LAWS, law_of_column, quantities_of
from residual_mpc.effects.ops import Array, Ops
from residual_mpc.effects.plugged import plugged_in

BUILT_IN: tuple[Effect, ...] = (
    *command.EFFECTS,
    *actuator.EFFECTS,
    *position_servo.EFFECTS,
    *drive.EFFECTS,
    *surroundings.TORQUES,
    body.GEAR_EFFICIENCY,
    *surroundings.CONSTRAINTS,
    *body.EFFECTS,
    *contact.EFFECTS,
    *sensor.EFFECTS,
)
PLUGGED: tuple[Effect, ...] = plugged_in(frozenset(effect.name for effect in BUILT_IN))
LIBRARY: tuple[Effect, ...] = BUILT_IN + PLUGGED

HOSTED: tuple[Effect, ...] = LIBRARY + LAWS  # a fitted law has no name to search for, and acts like the others


class ByName(dict[str, Effect]):
    """Effects by name. Iteration lists those of the library; laws of logged columns are built on lookup."""

    def __missing__(self, name: str) -> Effect:
        found = law_of_column(name)
        if found is None:
            raise KeyError(name)
        return found

    def __contains__(self, name: object) -> bool:
        return super().__contains__(name) or (isinstance(name, str) and law_of_column(name) is not None)

    def get(self, name: str, default: Any = None) -> Any:
        return self[name] if name in self else default


BY_NAME = ByName({effect.name: effect for effect in HOSTED})
ORDER: dict[str, int] = {
    effect.name: place for place, effect in enumerate(sorted(HOSTED, key=lambda effect: not effect.listed))
}
CHAINED: tuple[Effect, ...] = tuple(sorted(HOSTED, key=lambda effect: effect.rank))  # stable: ties by the table

Sites = Mapping[Site, tuple[str, ...]]  # where effects can act on a robot -> its targets there
Effects = Mapping[str, Values]  # effect -> parameter -> values, those of Settings.effects

# by name: where in the chain, and at which site; a replay asks for these hundreds of times
PLACED: dict[str, tuple[int, Site, Effect]] = {e.name: (rank, e.place, e) for rank, e in enumerate(CHAINED)}
_CHANGED: dict[Quantity, list[tuple[str, str]]] = {}  # quantity -> effects and parameters, in the order of the chain
for _effect in CHAINED:
    for _parameter in _effect.parameters:
        if _parameter.quantity is not None:
            _CHANGED.setdefault(_parameter.quantity, []).append((_effect.name, _parameter.name))

FACTORS: frozenset[Quantity] = frozenset(
    {"wheel radius", "right wheel radius", "track width", "servo stiffness", "reading scale"}
)


def slots_of(effect: str, sites: Sites) -> tuple[str, ...]:
    """The targets that an effect has on a robot with these sites; empty where it has none, or is unknown."""
    return sites.get(BY_NAME[effect].place, ()) if effect in BY_NAME else ()


def present(effects: Effects, *sites: Site) -> Iterator[tuple[Effect, Values]]:
    """The effects at these sites, with their parameters, in the order of the chain."""
    here = [PLACED[name] for name in effects if name in PLACED and PLACED[name][1] in sites]
    for _, _, effect in sorted(here, key=itemgetter(0)):
        yield effect, effects[effect.name]


def elastic_line(ops: Ops, effects: Effects) -> tuple[Array, Array] | None:
    """Torque at position 0, N m, and stiffness, N m/rad, of the effects beside joints, which are linear in position;
    None without any."""
    laws = [(e.step, p) for e, p in present(effects, "elastic") if e.step is not None]
    if not laws:
        return None
    at_zero = sum(step(ops, p, 0.0) for step, p in laws)
    return at_zero, at_zero - sum(step(ops, p, 1.0) for step, p in laws)


def fitted_laws(ops: Ops, effects: Effects, site: Site, signals: Mapping[str, Array]) -> Array | None:
    """The sum of the laws at a site; None without any. signals: by the quantity that a law is a function of."""
    total = None
    for effect, p in present(effects, site):
        assert effect.step is not None
        value = effect.step(ops, p, *(signals[name] for name in quantities_of(effect)))
        total = value if total is None else total + value
    return total


def changes(effects: Effects, quantity: Quantity) -> Array | None:
    """What the effects make of a quantity of the model: the product of its factors, or the sum of what is added;
    None where none of them changes it."""
    total = None
    for effect, parameter in _CHANGED.get(quantity, ()):
        if effect in effects:
            value = effects[effect][parameter]
            total = value if total is None else total * value if quantity in FACTORS else total + value
    return total


def holder(quantity: Quantity) -> tuple[str, str]:
    """(effect, parameter): the first in the table that changes a quantity."""
    return next((e.name, p.name) for e in LIBRARY for p in e.parameters if p.quantity == quantity)
