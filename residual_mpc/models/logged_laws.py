"""Laws of logged columns, written into the sizes of the effects that carry them.

Over a prediction a column keeps the value that it has at the start, so that such a law is a number: a gain, a friction,
a torque. No robot needs to know of these laws.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from residual_mpc.effects.laws import CARRIERS, USUAL, Carrier, LawKind, curve, kind_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.ops import NUMPY
from residual_mpc.models.settings import Knob, Settings, Term, Values

NOTHING: Mapping[str, float] = {}


def columns_of(values: Values) -> tuple[str, ...]:
    """The logged columns that laws among these values depend on, sorted."""
    return tuple(sorted({kind.column for k in values if (kind := _logged(k.effect)) is not None}))


def columns_at(values: Values, known: Mapping[str, float] = NOTHING) -> dict[str, float]:
    """The value of each such column where no log is at hand: the known one, else the mean of the runs that its law was
    fitted to."""
    usual = {kind.column: v for k, v in values.items() if k.parameter == USUAL and (kind := _logged(k.effect))}
    return {column: float(known.get(column, usual.get(column, 0.0))) for column in columns_of(values)}


def carriers_of(values: Values) -> frozenset[str]:
    """The effects that laws among these values are written into."""
    return frozenset(CARRIERS[kind.of].effect for k in values if (kind := _logged(k.effect)) is not None)


def with_columns(settings: Settings, column: Callable[[str], np.ndarray]) -> Settings:
    """The settings with every law of a logged column written into its carrier. column(name) -> (n,): the column's value
    at the start of each row's prediction; its usual value stands for NaN.
    """
    laws = {e: kind for e in settings.effects if (kind := _logged(e)) is not None}
    if not laws:
        return settings
    effects = {e: p for e, p in settings.effects.items() if e not in laws}
    for name, kind in laws.items():
        carrier, p, z = CARRIERS[kind.of], settings.effects[name], column(kind.column)[:, None]
        law = np.asarray(curve(NUMPY, p, np.where(np.isfinite(z), z, p[USUAL])))  # (n, slots)
        null = {p.name: np.full_like(law, p.null) for p in BY_NAME[carrier.effect].parameters}
        there: Mapping[str, np.ndarray] = effects.get(carrier.effect, null)
        effects[carrier.effect] = {**there, carrier.parameter: _carried(carrier, there[carrier.parameter], law)}
    return replace(settings, effects=effects)


def at_values(values: Values, columns: Mapping[str, float] = NOTHING) -> Values:
    """The values with such laws written into their carriers, where the columns are as `columns_at` has them."""
    at = columns_at(values, columns)
    laws = {k.term: kind for k in values if (kind := _logged(k.effect)) is not None}
    out = {k: v for k, v in values.items() if k.term not in laws}
    for term, kind in laws.items():
        p = {k.parameter: v for k, v in values.items() if k.term == term}
        law = np.asarray(curve(NUMPY, p, np.float64(at[kind.column])))
        carrier = CARRIERS[kind.of]
        for target in _targets(out, carrier, term):
            knob, alike = (Knob(carrier.effect, t, carrier.parameter, term.changed) for t in (target, None))
            null = BY_NAME[carrier.effect].parameter(carrier.parameter).null
            out[knob] = float(_carried(carrier, np.array(out.get(knob, out.get(alike, null))), law))
    return out


def _targets(values: Values, carrier: Carrier, term: Term) -> list[str | None]:
    """Where a law's carrier changes: single targets first, as they take over the number of all alike."""
    single = [k.target for k in values if k.effect == carrier.effect and k.target is not None]
    return [term.target] if term.target is not None else [*dict.fromkeys(single), None]


def _carried(carrier: Carrier, size: np.ndarray, law: np.ndarray) -> np.ndarray:
    """The size of a carrier with a law on top."""
    return np.asarray(size * np.maximum(1.0 + law, 0.0) if carrier.factor else size + law)


def _logged(effect: str) -> LawKind | None:
    """The kind of a law of a logged column; None for any other effect."""
    kind = kind_of(effect)
    return kind if kind is not None and kind.on == "logged" else None
