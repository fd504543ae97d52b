"""Signs and zeros: a measurement that moves against its command, and one that stands off it at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi

import numpy as np

from residual_mpc.init.guess import Guess
from residual_mpc.init.rest import FEW, Rest, at_rest, flips
from residual_mpc.init.roles import Case, Driven, Roles, answer
from residual_mpc.init.units import InUnit
from residual_mpc.init.words import Quantity
from residual_mpc.logs.run import FloatArray

CLEAR = 0.7  # correlation with the other sign from which a sign counts as turned
BETTER = 0.4  # correlation by which one sign has to explain gravity better than another
SAGS = 0.03  # rad or m per 1: what servos commonly stand off their command
QUARTER, NEAR = pi / 2.0, 0.15  # rad: zeros of two conventions lie quarter turns apart


@dataclass(frozen=True)
class Turned:
    """A column's sign and zero: true = sign * unit * raw + offset."""

    sign: int = 1
    offset: float = 0.0  # rad or m
    why: str = ""
    sure: float = 1.0


def find_signs(
    case: Case, roles: Roles, units: Mapping[str, InUnit], kinds: Mapping[str, Quantity]
) -> tuple[dict[str, Turned], tuple[Guess, ...]]:
    """By column, where it has to be turned or moved; and what is worth a word and stays as it is."""
    turned: dict[str, Turned] = {}
    guesses: list[Guess] = []
    for group in ("position", "command"):
        for column in roles.of(group).values():
            zero = _middle(case, column, units)
            if zero is not None:
                turned[column] = zero
    driven = [Driven(d.name, d.joint, kinds[d.name]) for d in case.driven if d.name in roles.of("command")]
    against = [d for d in driven if _against(case, roles, d)]
    rest = _rest(case, roles, units, turned)
    for d in driven:
        turned |= _of_one(case, roles, rest, d, d in against, turned)
    turned |= _rates(case, roles, turned)
    rest = _rest(case, roles, units, turned)  # as it is with the signs put right
    for d in (d for d in driven if d.kind == "position"):
        moved, said = _zero(case, roles, rest, d, turned)
        turned |= moved
        guesses += said
    return turned, tuple(guesses)


def true_values(
    case: Case, column: str, units: Mapping[str, InUnit], turned: Mapping[str, Turned]
) -> FloatArray:
    """(n,) a column on the grid as it is understood."""
    how = turned.get(column, Turned())
    size = units[column].unit.size if column in units else 1.0
    return how.sign * size * case.signals.raw[column] + how.offset


def _rest(case: Case, roles: Roles, units: Mapping[str, InUnit], turned: Mapping[str, Turned]) -> Rest:
    places = {j: true_values(case, c, units, turned) for j, c in roles.of("position").items()}
    sent = {a: true_values(case, c, units, turned) for a, c in roles.of("command").items()}
    return at_rest(case, places, sent)


def _middle(case: Case, column: str, units: Mapping[str, InUnit]) -> Turned | None:
    """Encoder counts are commonly 0 at one end: the model's zero is then, at a guess, at the middle."""
    unit = units[column].unit
    x = case.signals.raw[column]
    if unit.counts < 2 or np.nanmin(x) < 0 or np.nanmax(x) >= unit.counts:
        return None
    why = f"counts run from 0 to {unit.counts - 1}, and zero is taken to be at the middle: nothing here tells"
    return Turned(1, -pi, why, 0.5)


def _against(case: Case, roles: Roles, driven: Driven) -> bool:
    column = roles.of("command")[driven.name]
    seen, by = answer(case, roles, column, driven)
    return by != column and seen.correlation < -CLEAR and seen.against < 0.5


def _of_one(
    case: Case, roles: Roles, rest: Rest, driven: Driven, against: bool, so_far: Mapping[str, Turned]
) -> dict[str, Turned]:
    """The turned columns of one actuator: position, command, or both."""
    command, position = roles.of("command")[driven.name], roles.of("position").get(driven.joint)
    joint = [j.name for j in case.anatomy.joints].index(driven.joint)
    fits: dict[tuple[int, int], float] = {}
    if case.anatomy.torque is not None and position and driven.kind in ("position", "effort") and len(rest) >= FEW:
        fits = flips(case.anatomy.torque, rest, joint, driven)
    if against:
        seen, by = answer(case, roles, command, driven)
        said = f"{by} moves against {command} (correlation {seen.correlation:.2f})"
        if position is None or command == position:
            return {command: _turn(so_far, command, said, 0.6)}
        told = fits and abs(fits[-1, 1] - fits[1, -1]) > BETTER and max(fits[-1, 1], fits[1, -1]) > CLEAR
        if told and fits[1, -1] > fits[-1, 1]:
            return {command: _turn(so_far, command, f"{said}, and gravity fits the position as it is", 0.8)}
        which = "gravity fits the command as it is" if told else "which of the two is turned, nothing here tells"
        return {position: _turn(so_far, position, f"{said}; {which}", 0.85 if told else 0.6)}
    if not fits or driven.kind == "effort":
        worse = bool(fits) and fits[1, -1] > CLEAR and fits[1, 1] < -CLEAR
        if worse:
            said = f"at rest {command} holds against gravity with the other sign (correlation {fits[1, 1]:.2f})"
            return {command: _turn(so_far, command, said, 0.8)}
        return {}
    if position and fits[-1, -1] > CLEAR and fits[1, 1] < fits[-1, -1] - 2.0 * BETTER:
        said = (
            f"at rest {driven.joint} sags against gravity as the model has it (correlation {fits[1, 1]:.2f}), and with"
            f" it with both signs turned ({fits[-1, -1]:.2f})"
        )
        return {c: _turn(so_far, c, said, 0.7) for c in (position, command)}
    return {}


def _turn(so_far: Mapping[str, Turned], column: str, why: str, sure: float) -> Turned:
    """The column turned about the zero that it has so far."""
    before = so_far.get(column, Turned())
    reasons = f"{why}; {before.why}" if before.why else why
    return Turned(-before.sign, -before.offset, reasons, min(sure, before.sure))


def _rates(case: Case, roles: Roles, turned: Mapping[str, Turned]) -> dict[str, Turned]:
    """Velocities that do not go like the rate of their position, once that is turned."""
    found = {}
    for joint, column in roles.of("velocity").items():
        position = roles.of("position").get(joint)
        if position is None or column == roles.of("command").get(joint):
            continue
        seen = case.signals.follows(position, column, source_rate=True)
        sign = turned.get(position, Turned()).sign
        if seen.correlation * sign < -CLEAR:
            other = f"with {position} turned" if sign < 0 else "as it is"
            found[column] = Turned(-1, 0.0, f"it has to go like the rate of {position}, {other}", 0.95)
        elif sign < 0 and abs(seen.correlation) < CLEAR:
            found[column] = Turned(-1, 0.0, f"{position} is turned", 0.6)
    return found


def _zero(
    case: Case, roles: Roles, rest: Rest, driven: Driven, turned: Mapping[str, Turned]
) -> tuple[dict[str, Turned], tuple[Guess, ...]]:
    """What a position stands off its command at rest."""
    position = roles.of("position").get(driven.joint)
    if position is None or len(rest) < FEW:
        return {}, ()
    joint = [j.name for j in case.anatomy.joints].index(driven.joint)
    off = rest.q[:, joint] - rest.sent[driven.name]
    offset, spread = float(np.median(off)), float(np.quantile(off, 0.9) - np.quantile(off, 0.1))
    if not case.signals.moves(position) or abs(offset) < max(SAGS, spread):
        return {}, ()
    unit = "m" if case.anatomy.joints[joint].slides else "rad"
    quarters = round(offset / QUARTER)
    said = f"at rest it stands {offset:.3g} {unit} off {roles.of('command')[driven.name]} (within {spread:.2g})"
    if unit == "rad" and quarters and abs(offset - quarters * QUARTER) < NEAR:
        before = turned.get(position, Turned())
        zero = before.offset - quarters * QUARTER
        reasons = f"{said}: {quarters} quarter turns between two zeros; which of the two the model has, nothing here tells"
        return {position: Turned(before.sign, zero, f"{before.why}; {reasons}" if before.why else reasons, 0.6)}, ()
    why = f"{said}; left as it is, since sag, friction or a bias does this and the diagnosis tells them apart"
    return {}, (Guess(f"offset of {position}", f"{offset:.3g} {unit}", why, 0.7),)
