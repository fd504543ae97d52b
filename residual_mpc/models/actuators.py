"""Actuators that a robot file declares, for models that name none: a URDF says nothing of its servos."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from math import inf
from typing import Literal, cast, get_args

from residual_mpc.errors import BadInput
from residual_mpc.logs.columns import did_you_mean

Kind = Literal["position", "velocity", "motor"]
NEEDED: Mapping[str, str] = {"position": "kp", "velocity": "kv"}  # the gain without which it would do nothing
MEANT: Mapping[str, Kind] = {  # by other names of the same
    "torque": "motor", "force": "motor", "effort": "motor", "current": "motor", "direct": "motor",
    "speed": "velocity", "rate": "velocity", "angle": "position", "servo": "position",
}  # fmt: skip


@dataclass(frozen=True)
class Actuator:
    """What drives one joint, on a joint that turns (N, m and N s/m for one that slides).

    Attributes:
        kind: what `command.*` is: a position (rad), a velocity (rad/s), or the torque itself (N m).
        kp: N m/rad. kv: N m s/rad.
        gear: torque at the joint per unit of the actuator's.
        limit: N m, the largest torque either way.
        armature: kg m^2, inertia of the rotor, as the joint sees it through the gear.
    """

    kind: Kind
    kp: float = 0.0
    kv: float = 0.0
    gear: float = 1.0
    limit: float = inf
    armature: float = 0.0


def read_actuators(
    tables: Mapping[str, object], where: str, misplaced: Callable[[str], str]
) -> dict[str, Actuator]:
    """The tables [actuator.JOINT] of a robot file, by joint. misplaced: what is said of a key that belongs elsewhere in
    the file, "" for any other.

    Raises:
        BadInput: a table that is none, an unknown kind or key, a gain that is missing or not positive.
    """
    return {joint: _actuator(table, f"{where}, [actuator.{joint}]", misplaced) for joint, table in tables.items()}


def _actuator(table: object, where: str, misplaced: Callable[[str], str]) -> Actuator:
    if not isinstance(table, Mapping):
        raise BadInput(f"must be a table, got {table!r}", where, 'write for example kind = "position" and kp = 20.0')
    kinds = get_args(Kind)
    kind = table.get("kind")
    if kind not in kinds:
        meant = MEANT.get(str(kind).strip().lower(), "position")
        raise BadInput(f"kind must be one of {', '.join(kinds)}, got {kind!r}", where, f'write kind = "{meant}"')
    numbers = [f.name for f in fields(Actuator) if f.name != "kind"]
    for key, value in table.items():
        if key == "kind":
            continue
        if key not in numbers:
            raise BadInput(f"unknown key {key!r}", where, misplaced(key) or did_you_mean(key, ["kind", *numbers]))
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1e300:
            raise BadInput(f"{key} must be a number >= 0, got {value!r}", where)
    needed = NEEDED.get(str(kind))
    if needed is not None and not table.get(needed):
        raise BadInput(f"a {kind} actuator needs {needed} > 0", where, f"add a line such as {needed} = 20.0")
    return Actuator(cast(Kind, kind), **{key: float(value) for key, value in table.items() if key != "kind"})
