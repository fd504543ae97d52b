"""All kinds of changes, and those that a half of a robot's runs can carry."""

from __future__ import annotations

from collections.abc import Sequence

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds import body, clock, drive, joint, sensor
from residual_mpc.blind.recorded.kinds.kind import Kind, Target
from residual_mpc.errors import BadInput

KINDS: tuple[Kind, ...] = (
    clock.DELAYED_COMMANDS,
    drive.ZONE,
    drive.WHEEL_GAIN,
    joint.FORCE,
    joint.STIFFNESS,
    joint.DRY,
    joint.DAMPING,
    body.CARRIED,
    body.LINK,
    joint.ROTOR,
    body.LENGTH,
    drive.RADIUS,
    drive.MISMATCH,
    drive.TRACK,
    clock.DELAYED_SENSORS,
    sensor.BIAS,
    sensor.SCALE,
    sensor.MOUNTING,
    sensor.OUTLIERS,
    clock.SKEW,
)
NAMES: tuple[str, ...] = tuple(dict.fromkeys(kind.effect for kind in KINDS))


def carried_by(half: Half, wanted: Sequence[str] = ()) -> tuple[tuple[Kind, tuple[Target, ...]], ...]:
    """The kinds that ``half`` can carry, with their targets there.

    wanted: effects that were asked for; empty: all. Raises `BadInput` for one that is unknown or that no kind can put
    into this half.
    """
    for name in wanted:
        if name not in NAMES:
            raise BadInput(f"unknown kind {name!r}", "--kind", f"kinds: {', '.join(NAMES)}")
    found: list[tuple[Kind, tuple[Target, ...]]] = []
    refused: dict[str, list[str]] = {}
    for kind in KINDS:
        if wanted and kind.effect not in wanted:
            continue
        try:
            found.append((kind, kind.targets(half)))
        except BadInput as error:
            refused.setdefault(kind.effect, []).append(error.what)
    carried = {kind.effect for kind, _ in found}
    for name in wanted:
        if name not in carried:
            why = "; ".join(dict.fromkeys(refused[name]))
            raise BadInput(why, f"--kind {name}", "choose another kind or other runs")
    return tuple(found)


def why_not(half: Half) -> dict[str, str]:
    """By effect, why ``half`` cannot carry it."""
    carried = {kind.effect for kind, _ in carried_by(half)}
    reasons: dict[str, str] = {}
    for name in NAMES:
        if name not in carried:
            try:
                carried_by(half, (name,))
            except BadInput as error:
                reasons[name] = error.what
    return reasons
