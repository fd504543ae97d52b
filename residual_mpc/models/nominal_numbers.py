"""The numbers of the nominal robot that a model was made with, and whether they are still the same.

A model file names effects of a nominal robot: on a robot file whose masses, gains or sizes have changed since, they no
longer add up, and where the change was made because of the diagnosis (`export --to mjcf`), they count twice.
"""

import math
import warnings
from collections.abc import Mapping
from typing import Any

from residual_mpc.effects.body import PAYLOAD
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot

KEY = "nominal"  # of a model file: number by name
SITE = "payload_site."  # begins the names of the numbers that say where a payload is held
SAME = 1e-6  # relative difference up to which two numbers are the same
NAMED = 3  # differences that a warning spells out


class OtherNominal(UserWarning):
    """A model is used with a nominal robot whose numbers are not those that it was made with."""


def nominal_numbers(robot: Robot) -> dict[str, float]:
    """The robot's nominal parameters by name, in the units of its model file, and where its payload site is, m."""
    out = {name: float(value) for name, value in robot.nominal().items() if math.isfinite(value)}
    place = optional.payload_place(robot)
    return out if place is None else out | {f"{SITE}{k}": x for k, x in zip(("body", *"xyz"), place, strict=True)}


def differences(model: Mapping[str, Any], robot: Robot) -> dict[str, tuple[float | None, float | None]]:
    """The nominal numbers that differ, (when the model was made, now); None where a number is absent. Empty for a model
    file that does not state them. The place of the payload site matters to a payload alone."""
    then = model.get(KEY)
    if not isinstance(then, Mapping):
        return {}
    now = nominal_numbers(robot)
    if not (_has_payload(model) and any(name.startswith(SITE) for name in then)):
        then, now = ({k: v for k, v in these.items() if not k.startswith(SITE)} for these in (then, now))
    return {name: (then.get(name), now.get(name)) for name in then.keys() | now.keys() if _differ(then, now, name)}


def warn_of_differences(model: Mapping[str, Any], robot: Robot, where: str) -> None:
    """Warn where the robot is not the one that the model in the file `where` was made with."""
    found = sorted(differences(model, robot).items())
    told = [f"{name} was {_told(then)}, is {_told(now)}" for name, (then, now) in found[:NAMED]]
    if model.get("robot") != robot.name:
        told.insert(0, f"it was {model.get('robot')!r}, is {robot.name!r}")
    if len(found) > NAMED:
        told.append(f"{len(found) - NAMED} more")
    if told:
        warnings.warn(
            f"{where}: the nominal model is not the one that this file was made with ({'; '.join(told)}). The effects "
            "were fitted to the other model: use that one, or diagnose again.",
            OtherNominal,
            stacklevel=2,
        )


def _has_payload(model: Mapping[str, Any]) -> bool:
    return any(isinstance(v, Mapping) and v.get("effect") == PAYLOAD.name for v in model.get("values") or ())


def _differ(then: Mapping[str, Any], now: Mapping[str, float], name: str) -> bool:
    a, b = then.get(name), now.get(name)
    if not isinstance(a, int | float) or b is None:
        return True
    return not math.isclose(a, b, rel_tol=SAME, abs_tol=1e-9 if name.startswith(SITE) else 0.0)


def _told(number: Any) -> str:
    return f"{number:.6g}" if isinstance(number, int | float) else "absent"
