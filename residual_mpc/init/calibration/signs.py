"""Signs and zeros: a measurement that moves against its command, and one that stands off it at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from residual_mpc.init.calibration.servos import fit_gain, motion_of
from residual_mpc.init.calibration.standstill import FEW, StandstillSamples, at_rest, flips, still
from residual_mpc.init.calibration.units import UnitGuess
from residual_mpc.init.columns.evidence import ColumnEvidence, JointDrive, Roles, joint_response
from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.words import Quantity
from residual_mpc.logs.run import FloatArray

CLEAR = 0.7  # correlation with the other sign from which a sign counts as turned
BETTER = 0.4  # correlation by which one sign has to explain gravity better than another
SAGS = 0.03  # rad or m per 1: what servos commonly stand off their command
QUARTER, NEAR = pi / 2.0, 0.15  # rad: zeros of two conventions lie quarter turns apart


@dataclass(frozen=True)
class SignAndZero:
    """A column's sign and zero: true = sign * unit * raw + offset."""

    sign: int = 1
    offset: float = 0.0  # rad or m
    why: str = ""
    sure: float = 1.0


def find_signs(
    case: ColumnEvidence, roles: Roles, units: Mapping[str, UnitGuess], kinds: Mapping[str, Quantity]
) -> tuple[dict[str, SignAndZero], tuple[Guess, ...]]:
    """By column, where it has to be turned or moved; and what is worth a word and stays as it is."""
    turned: dict[str, SignAndZero] = {}
    guesses: list[Guess] = []
    for group in ("position", "command"):
        for column in roles.of(group).values():
            zero = _middle(case, column, units)
            if zero is not None:
                turned[column] = zero
    driven = [replace(d, kind=kinds[d.name]) for d in case.driven if d.name in roles.of("command")]
    against = {d.name: _turned_one(case, roles, d, turned) for d in driven if _against(case, roles, d)}
    turned |= {column: turn for found in against.values() for column, turn in found.items()}
    for d in (d for d in driven if d.kind == "position"):
        moved, said = _zero(case, roles, units, d, turned)
        turned |= moved
        guesses += said
    if not any(t.offset for t in turned.values()):  # gravity is asked where the zeros are known alone
        turned = _by_gravity(case, roles, units, driven, against, turned)
    for d in (d for d in driven if d.kind == "effort"):
        turned |= _by_dynamics(case, roles, units, d, turned)
    return turned | _rates(case, roles, turned), tuple(guesses)


def true_values(
    case: ColumnEvidence, column: str, units: Mapping[str, UnitGuess], turned: Mapping[str, SignAndZero]
) -> FloatArray:
    """(n,) a column on the grid as it is understood."""
    how = turned.get(column, SignAndZero())
    size = units[column].unit.size if column in units else 1.0
    return how.sign * size * case.signals.raw[column] + how.offset


def _rest(
    case: ColumnEvidence, roles: Roles, units: Mapping[str, UnitGuess], turned: Mapping[str, SignAndZero]
) -> StandstillSamples:
    places = {j: true_values(case, c, units, turned) for j, c in roles.of("position").items()}
    gears = {d.name: d.gear for d in case.driven}
    sent = {a: true_values(case, c, units, turned) / gears[a] for a, c in roles.of("command").items()}
    return at_rest(case, places, sent)


def _middle(case: ColumnEvidence, column: str, units: Mapping[str, UnitGuess]) -> SignAndZero | None:
    """Encoder counts are commonly 0 at one end: the model's zero is then, at a guess, at the middle."""
    unit = units[column].unit
    x = case.signals.raw[column]
    if unit.counts < 2 or np.nanmin(x) < 0 or np.nanmax(x) >= unit.counts:
        return None
    why = f"counts run from 0 to {unit.counts - 1}; zero is assumed to be at the middle, which the data cannot confirm"
    return SignAndZero(1, -pi, why, 0.5)


def _against(case: ColumnEvidence, roles: Roles, driven: JointDrive) -> bool:
    column = roles.of("command")[driven.name]
    seen, by = joint_response(case, roles, column, driven)
    clear = seen.correlation < -CLEAR and seen.against < max(0.5, -seen.correlation - 0.3)
    return by != column and (clear or seen.opposite)


def _turned_one(
    case: ColumnEvidence, roles: Roles, driven: JointDrive, so_far: Mapping[str, SignAndZero]
) -> dict[str, SignAndZero]:
    """The position turned, where the two move against each other and nothing tells which of them it is."""
    command, position = roles.of("command")[driven.name], roles.of("position").get(driven.joint)
    seen, by = joint_response(case, roles, command, driven)
    said = f"{by} moves opposite to {command} (correlation {seen.correlation:.2f})"
    column = command if position in (None, command) else position
    assert column is not None
    return {column: _turn(so_far, column, f"{said}; the data cannot tell which of the two is reversed", 0.6)}


def _by_gravity(
    case: ColumnEvidence,
    roles: Roles,
    units: Mapping[str, UnitGuess],
    driven: Sequence[JointDrive],
    against: Mapping[str, Mapping[str, SignAndZero]],
    turned: Mapping[str, SignAndZero],
) -> dict[str, SignAndZero]:
    """What is turned, with gravity's word on it where it has one; `against`: by actuator, what was turned already."""
    out = dict(turned)
    rest = _rest(case, roles, units, turned)
    torque = case.structure.torque
    if torque is None or len(rest) < FEW:
        return out
    names = [j.name for j in case.structure.joints]
    for d in driven:
        command, position = roles.of("command")[d.name], roles.of("position").get(d.joint)
        if position is None or position == command or d.kind != "position":
            continue
        fits = flips(torque, rest, names.index(d.joint), d)
        if not fits:
            continue
        both, neither = fits[-1, -1], fits[1, 1]
        if d.name in against:
            seen, by = joint_response(case, roles, command, d)
            said = f"{by} moves opposite to {command} (correlation {seen.correlation:.2f})"
            if both > CLEAR and both - neither > BETTER:  # with the position turned back, and the command turned
                del out[position]
                out[command] = _turn(
                    out, command, f"{said}, and gravity is consistent with the position as logged", 0.8
                )
            elif neither > CLEAR and neither - both > BETTER:
                why = f"{said}, and gravity is consistent with the command as logged"
                out[position] = replace(out[position], why=why, sure=0.8)
        elif both > CLEAR and both - neither > 2.0 * BETTER:
            said = (
                f"at rest {d.joint} deviates from its command against gravity (correlation {neither:.2f}), but with"
                f" gravity if both signs are reversed ({both:.2f})"
            )
            out |= {c: _turn(out, c, said, 0.6) for c in (position, command)}
    return out


def _by_dynamics(
    case: ColumnEvidence,
    roles: Roles,
    units: Mapping[str, UnitGuess],
    driven: JointDrive,
    turned: Mapping[str, SignAndZero],
) -> dict[str, SignAndZero]:
    """A torque that explains the motion, by the model's inverse dynamics, once it or the motion is turned."""
    command, position = roles.of("command")[driven.name], roles.of("position").get(driven.joint)
    if position is None:
        return {}
    places = {j: true_values(case, c, units, turned) for j, c in roles.of("position").items()}
    sent = true_values(case, command, units, turned)
    shares = {}
    for sign in (1, -1):
        motion = motion_of(case, {**places, driven.joint: sign * places[driven.joint]})
        if motion is None:
            return {}
        for way in (1, -1):
            fit = fit_gain(case, motion, driven, way * sent, "effort")
            shares[sign, way] = 0.0 if fit is None or fit.gain <= 0.0 else fit.explained
    best = max(shares, key=lambda k: shares[k])
    if best == (1, 1) or shares[best] < 0.5 or shares[best] - shares[1, 1] < BETTER:
        return {}
    said = f"the torque explains {shares[1, 1]:.0%} of the motion as logged, {shares[best]:.0%} with this sign reversed"
    found = {}
    if best[1] < 0:
        found[command] = _turn(turned, command, said, 0.7)
    if best[0] < 0:
        found[position] = _turn(turned, position, said, 0.7)
    return found


def _turn(so_far: Mapping[str, SignAndZero], column: str, why: str, sure: float) -> SignAndZero:
    """The column turned about the zero that it has so far."""
    before = so_far.get(column, SignAndZero())
    reasons = f"{why}; {before.why}" if before.why else why
    return SignAndZero(-before.sign, -before.offset, reasons, min(sure, before.sure))


def _rates(case: ColumnEvidence, roles: Roles, turned: Mapping[str, SignAndZero]) -> dict[str, SignAndZero]:
    """Velocities that do not go like the rate of their position, once that is turned."""
    found = {}
    for joint, column in roles.of("velocity").items():
        position = roles.of("position").get(joint)
        if position is None or column == roles.of("command").get(joint):
            continue
        seen = case.signals.follows(position, column, source_rate=True)
        sign = turned.get(position, SignAndZero()).sign
        if seen.correlation * sign < -CLEAR:
            other = " with its sign reversed" if sign < 0 else ""
            found[column] = SignAndZero(-1, 0.0, f"it must have the sign of the derivative of {position}{other}", 0.95)
        elif sign < 0 and abs(seen.correlation) < CLEAR:
            found[column] = SignAndZero(-1, 0.0, f"{position} is reversed", 0.6)
    return found


def _zero(
    case: ColumnEvidence,
    roles: Roles,
    units: Mapping[str, UnitGuess],
    driven: JointDrive,
    turned: Mapping[str, SignAndZero],
) -> tuple[dict[str, SignAndZero], tuple[Guess, ...]]:
    """What a position stands off its command at rest."""
    command, position = roles.of("command")[driven.name], roles.of("position").get(driven.joint)
    if position is None or position == command or not case.signals.moves(position):
        return {}, ()
    joint = [j.name for j in case.structure.joints].index(driven.joint)
    q, u = true_values(case, position, units, turned), true_values(case, command, units, turned) / driven.gear
    rest = still(case, (q, u))
    if rest.sum() < FEW:
        return {}, ()
    off = (q - u)[rest]
    low, offset, high = (float(x) for x in np.quantile(off, [0.25, 0.5, 0.75]))
    spread = high - low
    if abs(offset) < max(SAGS, spread):
        return {}, ()
    unit = "m" if case.structure.joints[joint].slides else "rad"
    quarters = round(offset / QUARTER)
    said = f"at rest it differs from {command} by {offset:.3g} {unit} (interquartile range {spread:.2g})"
    if unit == "rad" and quarters and abs(offset - quarters * QUARTER) < NEAR:
        before = turned.get(position, SignAndZero())
        zero = before.offset - quarters * QUARTER
        reasons = f"{said}: the zeros are {quarters} quarter turns apart; the data cannot tell which is the model's"
        return {
            position: SignAndZero(before.sign, zero, f"{before.why}; {reasons}" if before.why else reasons, 0.6)
        }, ()
    why = f"{said}; not corrected, since sag, friction or a bias can cause this and the diagnosis separates them"
    return {}, (Guess(f"offset of {position}", f"{offset:.3g} {unit}", why, 0.7),)
