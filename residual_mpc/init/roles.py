"""Which column is what: names and data weighed as log odds, and every column given to one role at most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from residual_mpc.init.assign import NEVER, Odds, Rule, assign
from residual_mpc.init.guess import Guess
from residual_mpc.init.members import Members, members_of
from residual_mpc.init.signals import NOTHING, Seen, Signals
from residual_mpc.init.words import COMMAND_WORDS, QUANTITY_WORDS, Quantity, Words
from residual_mpc.logs.audit.facts import ActuatorFacts
from residual_mpc.logs.columns import PER_BODY, group
from residual_mpc.models.anatomy import Anatomy, Joint

CLEAR = 0.85  # correlation
ORDER = 0.3  # how sure, where nothing but the order of the columns tells joints apart
DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class Driven:
    """What drives a joint: an actuator of the model, or one that its file does not declare, whose kind is None."""

    name: str
    joint: str
    kind: Quantity | None


@dataclass(frozen=True, eq=False)
class Case:
    """All that the columns are weighed by."""

    anatomy: Anatomy
    signals: Signals
    words: Mapping[str, Words]

    @cached_property
    def driven(self) -> tuple[Driven, ...]:
        if self.anatomy.actuators:
            return tuple(_driven(a) for a in self.anatomy.actuators)
        return tuple(Driven(j.name, j.name, None) for j in self.anatomy.joints)

    @cached_property
    def joints(self) -> Members:
        """The joints, by their own names and by those of their actuators."""
        aliases = [
            (j.name, *(d.name for d in self.driven if d.joint == j.name and d.name != j.name))
            for j in self.anatomy.joints
        ]
        return members_of(aliases, tuple(self.words.values()))

    @cached_property
    def actuators(self) -> Members:
        """The actuators, by their own names and by those of their joints."""
        return members_of([tuple(dict.fromkeys((d.name, d.joint))) for d in self.driven], tuple(self.words.values()))

    @cached_property
    def moving(self) -> tuple[str, ...]:
        return tuple(n for n in self.words if self.signals.moves(n))


@dataclass(frozen=True)
class Roles:
    """columns: log name -> column. guesses: one a role."""

    columns: Mapping[str, str]
    guesses: tuple[Guess, ...] = ()

    def of(self, group: str) -> dict[str, str]:
        """Member -> column of a group such as `position`."""
        return {n.partition(".")[2]: c for n, c in self.columns.items() if n.partition(".")[0] == group}

    def plus(self, other: Roles) -> Roles:
        return Roles({**self.columns, **other.columns}, (*self.guesses, *other.guesses))


def find_roles(case: Case) -> Roles:
    """Positions first, then what relates to them: velocities, commands, efforts, switches."""
    roles = _with(case, _positions(case), Roles({}))
    roles = _with(case, _velocities(case, roles), roles)
    roles = _with(case, _commands(case, roles), roles)
    roles = _with(case, _efforts(case), roles)
    return _no_surer(case, _with(case, _switches(case), roles))


def where_on(case: Case, roles: Roles) -> Case:
    """The case where every actuator is switched on: elsewhere no command is followed."""
    on = np.ones(len(case.signals.run), dtype=bool)
    for column in roles.of("enabled").values():
        on &= ~(case.signals.raw[column] < 0.5)
    if on.all() or not on.any():
        return case
    raw = {name: np.where(on, x, np.nan) for name, x in case.signals.raw.items()}
    return replace(case, signals=Signals(case.signals.dt, raw, case.signals.run, case.signals.whole))


def _driven(actuator: ActuatorFacts) -> Driven:
    kinds: Mapping[str, Quantity] = {"position": "position", "velocity": "velocity", "torque": "effort"}
    return Driven(actuator.name, actuator.joint or actuator.name, kinds[actuator.kind])


def _with(case: Case, rules: Mapping[str, Rule], roles: Roles) -> Roles:
    """`roles`, and more among the columns that are free."""
    used = set(roles.columns.values())
    guesses = assign(rules, (w for n, w in case.words.items() if n not in used))
    return roles.plus(Roles({g.what: g.value for g in guesses}, guesses))


def _no_surer(case: Case, roles: Roles) -> Roles:
    """Joints told apart by the order of the columns alone are hardly told apart, nor is what goes with them."""
    joints = [j.name for j in case.anatomy.joints]
    driven = {d.name: d.joint for d in case.driven}
    of = {g.what: g for g in roles.guesses}

    def unnamed(guess: Guess) -> bool:
        name, _, who = guess.what.partition(".")
        if name not in ("position", "velocity", "command") or len(joints) < 2:
            return False
        joint = driven.get(who, who) if name == "command" else who
        return case.joints.evidence(case.words[guess.value], joints.index(joint))[0] < 1.0

    nobodys = tuple(g.value for g in roles.guesses if g.what.startswith("position.") and unnamed(g))
    guesses = []
    for guess in roles.guesses:
        name, _, who = guess.what.partition(".")
        if unnamed(guess):
            position = of.get(f"position.{driven.get(who, who) if name == 'command' else who}")
            at_most = ORDER if name == "position" or position is None or unnamed(position) else position.sure
            rivals = tuple(n for n in nobodys if n != guess.value) if name == "position" else guess.rivals
            guess = replace(guess, sure=min(guess.sure, at_most), rivals=rivals)
        guesses.append(guess)
    return Roles(roles.columns, tuple(guesses))


# --- positions --------------------------------------------------------------------------------------------------------


def _positions(case: Case) -> dict[str, Rule]:
    nameless = any(not w.kind for w in case.words.values())
    leads = _leads(case) if nameless else {}
    return {
        f"position.{joint.name}": partial(_position, case, leads, i, joint)
        for i, joint in enumerate(case.anatomy.joints)
    }


def _position(case: Case, leads: Mapping[str, float], member: int, joint: Joint, words: Words) -> Odds:
    if words.quantity not in (None, "position") or words.commanded and not words.measured:
        return NEVER, ()
    if group(words.name) in PER_BODY:
        return NEVER, ()
    if not case.signals.moves(words.name) and words.quantity is None and not words.measured:
        return NEVER, ()
    whose, why = case.joints.evidence(words, member)
    odds, reasons = whose, [why]
    if words.quantity == "position":
        odds, reasons = odds + 3.0, [*reasons, f"it is called a position ({_called(words, 'position')})"]
    elif words.measured:
        odds += 1.5
    if words.name in leads:
        late = leads[words.name]
        odds += 2.5 if late > 0.0 else -3.0
        reasons.append("it follows another column" if late > 0.0 else "")
    inside, said = _inside(case.signals, words, joint)
    return odds + inside, (*reasons, said)


def _leads(case: Case) -> dict[str, float]:
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


def _inside(signals: Signals, words: Words, joint: Joint) -> tuple[float, str]:
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
    return (0.5, "within its range") if best > 0.98 else (-1.5 * (1.0 - best), "")


# --- velocities -------------------------------------------------------------------------------------------------------


def _velocities(case: Case, roles: Roles) -> dict[str, Rule]:
    positions = roles.of("position")
    return {
        f"velocity.{joint.name}": partial(_velocity, case, i, positions.get(joint.name))
        for i, joint in enumerate(case.anatomy.joints)
    }


def _velocity(case: Case, member: int, position: str | None, words: Words) -> Odds:
    if words.quantity not in (None, "velocity") or words.commanded and not words.measured:
        return NEVER, ()
    whose, why = case.joints.evidence(words, member)
    odds, reasons = whose, [why]
    if words.quantity == "velocity":
        odds, reasons = odds + 3.0, [*reasons, f"it is called a velocity ({_called(words, 'velocity')})"]
    seen = case.signals.follows(position, words.name, source_rate=True) if position else NOTHING
    r = abs(seen.correlation)
    if r > 0.5 and abs(seen.lag) < 0.15:
        odds += 4.0 * r * r
        reasons.append(f"it goes like the rate of {position} (correlation {seen.correlation:.2f})")
    elif position and seen is not NOTHING and r < 0.3:
        odds -= 2.0
    if words.quantity is None and r < 0.9:
        return NEVER, ()
    return odds, tuple(reasons)


# --- commands ---------------------------------------------------------------------------------------------------------


def _commands(case: Case, roles: Roles) -> dict[str, Rule]:
    return {f"command.{d.name}": partial(_command, case, roles, i, d) for i, d in enumerate(case.driven)}


def _command(case: Case, roles: Roles, member: int, driven: Driven, words: Words) -> Odds:
    if words.quantity in ("acceleration", "enabled", "other") or words.measured and not words.commanded:
        return NEVER, ()
    if not np.isfinite(case.signals.raw[words.name]).any():
        return NEVER, ()
    whose, why = case.actuators.evidence(words, member)
    odds, reasons = whose, [why]
    if words.commanded:
        odds, reasons = odds + 3.0, [*reasons, f"it is called a command ({_called(words, 'command')})"]
    if words.quantity is not None and driven.kind is not None:
        same = words.quantity == driven.kind
        odds += 1.5 if same else -2.5
        reasons.append(f"of the {driven.kind} that the actuator takes" if same else "")
    elif words.quantity is not None and not words.commanded:
        odds -= 1.0
    seen, what = answer(case, roles, words.name, driven)
    r = abs(seen.correlation)
    if r > 0.5:
        odds += 4.0 * r * r - (1.5 if seen.lag < -2.0 * case.signals.dt else 0.0)
        reasons.append(f"{what} {seen.words('it')}")
    elif seen is not NOTHING and r < 0.2:
        odds -= 1.0
    if not words.commanded and r < (0.7 if words.kind else CLEAR):
        return NEVER, ()
    return odds, tuple(reasons)


def answer(case: Case, roles: Roles, column: str, driven: Driven) -> tuple[Seen, str]:
    """How the joint answers a column that may be its command, and the column by which it was seen."""
    position, velocity = (roles.of(g).get(driven.joint) for g in ("position", "velocity"))
    seen: list[tuple[Seen, str]] = []
    s = case.signals
    if driven.kind in (None, "position") and position:
        seen.append((s.follows(column, position), position))
    if driven.kind in (None, "velocity"):
        if velocity:
            seen.append((s.follows(column, velocity, levels=True), velocity))
        if position:
            seen.append((s.follows(column, position, answer_rate=True, levels=True), f"the rate of {position}"))
    return max(seen, key=lambda x: abs(x[0].correlation), default=(NOTHING, ""))


# --- efforts and switches ---------------------------------------------------------------------------------------------


def _efforts(case: Case) -> dict[str, Rule]:
    return {f"effort.{j.name}": partial(_effort, case, i) for i, j in enumerate(case.anatomy.joints)}


def _effort(case: Case, member: int, words: Words) -> Odds:
    # a current is no torque, though it may be proportional to one
    amps = {"current", "currents", "amps", "amp", "load"} & set(words.every)
    if words.quantity != "effort" or words.commanded or amps:
        return NEVER, ()
    whose, why = case.joints.evidence(words, member)
    return whose + 2.0, (why, "it is called an effort")


def _switches(case: Case) -> dict[str, Rule]:
    return {f"enabled.{d.name}": partial(_switch, case, i) for i, d in enumerate(case.driven)}


def _switch(case: Case, member: int, words: Words) -> Odds:
    x = case.signals.raw[words.name]
    x = x[np.isfinite(x)]
    if words.quantity != "enabled" or not len(x) or np.isin(x, (0.0, 1.0)).mean() < 0.9:
        return NEVER, ()
    whose, why = case.actuators.evidence(words, member)
    return whose + 2.0, (why, "it is called a switch and is 0 or 1")


def _called(words: Words, quantity: str) -> str:
    said: Sequence[str] = [
        w for w in words.every if QUANTITY_WORDS.get(w) == quantity or quantity == "command" and w in COMMAND_WORDS
    ]
    return ", ".join(dict.fromkeys(said)) or "d"
