"""Effects that no data of some kind can part: the one list, for sealing, withholding and scoring."""

from __future__ import annotations

from collections.abc import Collection

# (effect, its twin, traits that the runs must have for the two to be one). Each row is read both ways.
_TWINS: tuple[tuple[str, str, frozenset[str]], ...] = (
    ("wheel_radius", "actuator_gain", frozenset({"wheeled", "no_encoders"})),
    ("wheel_radius_mismatch", "actuator_gain", frozenset({"wheeled", "no_encoders"})),
    ("command_delay", "sensor_delay", frozenset({"wheeled", "no_encoders"})),
    ("wheel_radius", "longitudinal_slip", frozenset({"wheeled", "straight"})),
    ("wheel_radius", "slope", frozenset({"wheeled", "straight"})),
    ("longitudinal_slip", "slope", frozenset({"wheeled", "straight"})),
    ("actuator_gain", "longitudinal_slip", frozenset({"wheeled", "straight", "no_encoders"})),
    ("actuator_gain", "slope", frozenset({"wheeled", "straight", "no_encoders"})),
    ("command_delay", "sensor_delay", frozenset({"arm", "no_drops"})),
    ("coulomb_friction", "stribeck_friction", frozenset({"arm"})),
    ("payload", "link_mass", frozenset({"arm", "com_near_site"})),
)


def twins_of(effect: str, traits: Collection[str]) -> tuple[str, ...]:
    """Names of the effects that runs with ``traits`` cannot part from ``effect``, sorted."""
    have = frozenset(traits)
    found = {b if effect == a else a for a, b, need in _TWINS if effect in (a, b) and need <= have}
    return tuple(sorted(found))
