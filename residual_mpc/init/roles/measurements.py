"""Whether a column measures a joint: its position, its velocity or its effort."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from residual_mpc.init.columns.evidence import ColumnEvidence, Roles
from residual_mpc.init.columns.signals import CLEAR, NOTHING, Signals
from residual_mpc.init.columns.words import ColumnName, called
from residual_mpc.init.roles.assignment import NEVER, Odds, Rule
from residual_mpc.init.roles.velocity_check import ALIKE, velocity_columns
from residual_mpc.logs.columns import PER_BODY, group
from residual_mpc.models.model_structure import Joint

DEGREES = 180.0 / np.pi


def positions(case: ColumnEvidence) -> dict[str, Rule]:
    nameless = any(not w.kind for w in case.words.values())
    leads = _leads(case) if nameless else {}
    return {
        f"position.{joint.name}": partial(_position, case, leads, i, joint)
        for i, joint in enumerate(case.structure.joints)
    }


def _position(case: ColumnEvidence, leads: Mapping[str, float], member: int, joint: Joint, words: ColumnName) -> Odds:
    if words.quantity not in (None, "position") or words.commanded and not words.measured:
        return NEVER, ()
    if group(words.name) in PER_BODY:
        return NEVER, ()
    if not case.signals.moves(words.name) and words.quantity is None and not words.measured:
        return NEVER, ()
    whose, why = case.joints.evidence(words, member)
    odds, reasons = whose, [why]
    if words.quantity == "position":
        odds, reasons = odds + 3.0, [*reasons, f"its name says position ({called(words, 'position')})"]
    elif words.measured:
        odds += 1.5
    if words.name in leads:
        late = leads[words.name]
        odds += 2.5 if late > 0.0 else -3.0
        reasons.append("it follows another column after a delay" if late > 0.0 else "")
    inside, said = _inside(case.signals, words, joint)
    return odds + inside, (*reasons, said)


def _leads(case: ColumnEvidence) -> dict[str, float]:
    """+1 for columns that come after another of which they are the answer, -1 for those that such an answer follows or
    that are the rate of another; only columns whose names say nothing."""
    s, out = case.signals, {}
    names = [n for n in case.moving if case.words[n].quantity in (None, "position", "velocity")]
    for name in (n for n in names if not case.words[n].kind):
        before = after = rate = NOTHING
        for other in names:
            if other == name:
                continue
            seen = s.follows(other, name)
            if seen.lag > 0.3 * s.dt and abs(seen.correlation) > abs(before.correlation):
                before = seen
            if seen.lag < -0.3 * s.dt and abs(seen.correlation) > abs(after.correlation):
                after = seen
            of = s.follows(other, name, source_rate=True)
            if abs(of.lag) < 0.1 and abs(of.correlation) > abs(rate.correlation):
                rate = of
        strongest = max((before, after, rate), key=lambda x: abs(x.correlation))
        if abs(strongest.correlation) > CLEAR:
            # a rate leads its position by a quarter period, and is told by its likeness to the derivative
            is_rate = abs(rate.correlation) > max(0.95, abs(before.correlation), abs(after.correlation))
            out[name] = -1.0 if is_rate or abs(after.correlation) > abs(before.correlation) else 1.0
    return out


def _inside(signals: Signals, words: ColumnName, joint: Joint) -> tuple[float, str]:
    """Whether the column stays within the joint's range, in the unit that fits better."""
    if joint.limits is None or words.unit not in (None, "rad", "deg", "degree", "degrees", "m"):
        return 0.0, ""
    low, high = joint.limits
    margin = 0.1 * (high - low)
    x = signals.raw[words.name]
    x = x[np.isfinite(x)]
    if not len(x):
        return -1.0, ""
    shares = [float(np.mean((x * f > low - margin) & (x * f < high + margin))) for f in (1.0, 1.0 / DEGREES)]
    best = max(shares[:1] if joint.slides else shares)
    return (0.5, "within the joint range") if best > 0.98 else (-1.5 * (1.0 - best), "")


def velocities(case: ColumnEvidence, roles: Roles) -> dict[str, Rule]:
    found = roles.of("position")
    unnamed = velocity_columns(case, found)
    return {
        f"velocity.{joint.name}": partial(_velocity, case, unnamed, i, found.get(joint.name))
        for i, joint in enumerate(case.structure.joints)
    }


def _velocity(
    case: ColumnEvidence, unnamed: frozenset[str], member: int, position: str | None, words: ColumnName
) -> Odds:
    if words.quantity not in (None, "velocity") or words.commanded and not words.measured:
        return NEVER, ()
    whose, why = case.joints.evidence(words, member)
    odds, reasons = whose, [why]
    if words.quantity == "velocity":
        odds, reasons = odds + 3.0, [*reasons, f"its name says velocity ({called(words, 'velocity')})"]
    seen = case.signals.follows(position, words.name, source_rate=True) if position else NOTHING
    r = abs(seen.correlation)
    if r > 0.5 and abs(seen.lag) < 0.15:
        odds += 4.0 * r * r
        reasons.append(f"it matches the derivative of {position} (correlation {seen.correlation:.2f})")
    elif position and seen is not NOTHING and r < 0.3:
        odds -= 2.0
    if words.quantity is None and (words.name not in unnamed or r < ALIKE):
        return NEVER, ()
    return odds, tuple(reasons)


def efforts(case: ColumnEvidence) -> dict[str, Rule]:
    return {f"effort.{j.name}": partial(_effort, case, i) for i, j in enumerate(case.structure.joints)}


def _effort(case: ColumnEvidence, member: int, words: ColumnName) -> Odds:
    # a current is no torque, though it may be proportional to one
    amps = {"current", "currents", "curr", "iq", "amps", "amp", "ampere", "amperes", "load"} & set(words.every)
    if words.quantity != "effort" or words.commanded or amps:
        return NEVER, ()
    whose, why = case.joints.evidence(words, member)
    return whose + 2.0, (why, "its name says effort")
