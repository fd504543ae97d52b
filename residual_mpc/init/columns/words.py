"""What a column's name says: a command or a measurement, of which quantity, in which unit, and of whom."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Literal

Quantity = Literal["position", "velocity", "effort", "acceleration", "enabled", "other"]

COMMAND_WORDS = frozenset(
    "cmd command commands commanded des desired target targets goal goals ref reference setpoint sp action actions"
    " set sent ctrl control input request requested demand demanded planned u".split()
)
MEASURED_WORDS = frozenset(
    "actual measured meas present state states observation observations obs feedback fb sensor sensed real".split()
)
QUANTITY_WORDS: Mapping[str, Quantity] = {
    word: quantity  # type: ignore[misc]
    for quantity, words in (
        ("position", "position positions pos q qpos angle angles ang theta encoder enc ticks counts displacement"),
        ("velocity", "velocity velocities vel speed speeds dq qd qdot qvel omega rate dtheta thetadot rpm dps w"),
        (
            "effort",
            "effort efforts eff torque torques torq trq tq nm tau force load moment"
            " current currents curr iq amps amp ampere amperes",
        ),
        ("acceleration", "acceleration accelerations acc accel qdd ddq qddot"),
        ("enabled", "enabled enable on active engaged"),
        (
            "other",
            "temperature temp voltage volt volts pwm error err status mode battery bus supply gain kp ki kd limit"
            " limits min max fault warning integral noise std var cov covariance abs power",
        ),
    )
    for word in words.split()
}
UNIT_WORDS = frozenset(
    "deg degree degrees dps rad radian radians rads rpm ticks tick counts count raw mm turns rev revs mrad".split()
)
GENERIC_WORDS = frozenset(
    "joint joints jnt motor motors servo servos actuator actuators axis robot dof data value".split()
)
TIME_WORDS = frozenset(
    "t time times timestamp timestamps stamp stamps clock sec secs seconds second nsec nsecs nanosec nanoseconds"
    " millis ms us ns msec usec micros nanos elapsed".split()
)
LETTERS = {"l": "left", "r": "right"}
SPLITTABLE = sorted(
    (w for w in (COMMAND_WORDS | MEASURED_WORDS | set(QUANTITY_WORDS)) - {"state", "other"} if len(w) >= 3),
    key=len,
    reverse=True,
)
KNOWN = COMMAND_WORDS | MEASURED_WORDS | set(QUANTITY_WORDS) | UNIT_WORDS | GENERIC_WORDS


@dataclass(frozen=True)
class ColumnName:
    """Attributes:
    name: the column's.
    commanded: whether it says that it is a command. measured: that it is a measurement.
    quantity: None where it says nothing.
    unit: a word of UNIT_WORDS, None where it says nothing.
    core: what is left: the words that name a joint or an actuator.
    every: all words.
    """

    name: str
    commanded: bool
    measured: bool
    quantity: Quantity | None
    unit: str | None
    core: tuple[str, ...]
    every: tuple[str, ...]

    @property
    def kind(self) -> bool:
        """Whether the name says anything of what the column is."""
        return self.commanded or self.measured or self.quantity is not None


def tokens(name: str) -> tuple[str, ...]:
    """The words of a name in small letters: `jointStates[2].pos_deg` -> joint, states, 2, pos, deg."""
    spaced = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    return tuple(re.findall(r"[a-z]+|\d+", spaced.lower()))


def read_words(name: str) -> ColumnName:
    """The words of a column's name, sorted by what they say."""
    every = tuple(part for word in tokens(name) for part in _parts(word))
    quantities = [QUANTITY_WORDS[w] for w in every if w in QUANTITY_WORDS]
    # `q_d` is desired, as in libfranka; `current_position` is no current
    commanded = any(w in COMMAND_WORDS for w in every) or "d" in every[1:]
    measured = any(w in MEASURED_WORDS for w in every)
    if "current" in every and {"position", "velocity"} & set(quantities):
        measured, quantities = True, [q for q in quantities if q != "effort"]
    quantity: Quantity | None = next((q for q in ("other", "enabled") if q in quantities), None)  # type: ignore[assignment]
    if quantity is None and quantities:
        quantity = quantities[-1]
    unit = next((w for w in every if w in UNIT_WORDS), None)
    return ColumnName(name, commanded, measured, quantity, unit, core(every), every)


def core(every: Sequence[str]) -> tuple[str, ...]:
    """The words that name someone; all of them where nothing else is left."""
    left = [w for w in every if w not in KNOWN and w != "d"]
    left = [w for w in left if w not in ("j", "m")] if any(w.isdigit() for w in left) else left
    return tuple(LETTERS.get(w, w) for w in left)


def core_of(name: str) -> tuple[str, ...]:
    """The core of a joint's or an actuator's name, whose words may all be generic."""
    every = tuple(part for word in tokens(name) for part in _parts(word))
    return core(every) or tuple(every)


def likeness(column: Sequence[str], member: Sequence[str]) -> float:
    """0 to 1: how far the words of a column name a joint or an actuator."""
    if not column or not member:
        return 0.0
    one, other = "".join(column), "".join(member)
    if one == other or set(column) == set(member):
        return 1.0
    if [w for w in column if w.isdigit()] != [w for w in member if w.isdigit()]:
        return 0.2 if one.strip("0123456789") == other.strip("0123456789") else 0.0
    if _contains(column, member) or len(other) >= 3 and other in one:
        return 0.9
    short, long = sorted((tuple(column), tuple(member)), key=len)
    if _abbreviates(short, long) or _abbreviates(long, short):
        return 0.8
    return 0.85 * SequenceMatcher(None, one, other, autojunk=False).ratio()


def _parts(word: str) -> list[str]:
    """A word without its own separators, such as `elbowpos`, in two."""
    if word in KNOWN or len(word) < 5 or word.isdigit():
        return [word]
    for known in SPLITTABLE:
        if word.endswith(known) and len(word) - len(known) >= 2:
            return [word[: -len(known)], known]
        if word.startswith(known) and len(word) - len(known) >= 2 and len(known) >= 4:
            return [known, word[len(known) :]]
    return [word]


def _contains(column: Sequence[str], member: Sequence[str]) -> bool:
    return set(member) <= set(column)


def _abbreviates(short: Sequence[str], long: Sequence[str]) -> bool:
    """Whether every word of `short` begins a word of `long`, in order."""
    rest = iter(long)
    return all(any(len(a) >= 2 and (w.startswith(a) or a == w) for w in rest) for a in short)


def called(words: ColumnName, quantity: str) -> str:
    """The words by which a column is called a quantity or a command, for a reason that is printed."""
    said: Sequence[str] = [
        w for w in words.every if QUANTITY_WORDS.get(w) == quantity or quantity == "command" and w in COMMAND_WORDS
    ]
    return ", ".join(dict.fromkeys(said)) or "d"
