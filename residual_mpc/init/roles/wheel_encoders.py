"""Columns that may be a wheel's encoder although their names do not say angle or speed."""

from collections.abc import Iterator, Mapping, Sequence

from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.signals import CLEAR, SignalMatch, Signals
from residual_mpc.init.columns.words import ColumnName, core_of, likeness
from residual_mpc.init.draft import Unmatched
from residual_mpc.logs.columns import member

ALIKE = 0.9  # likeness of a column's words to an actuator's or a joint's name
NEAR = 2.0  # times the commanded speed, up to which a wheel turns as it is told, in rad
SIDES = {"wl": "left", "lw": "left", "wr": "right", "rw": "right"}


def sides(words: ColumnName) -> tuple[str, ...]:
    """The core of a column's name, in which `wl` and `wr` are a left and a right wheel."""
    return tuple(SIDES.get(w, w) for w in words.core)


def turning_wheel(
    key: str, guesses: Sequence[Guess], signals: Signals, words: Mapping[str, ColumnName]
) -> Guess | None:
    """The column of a wheel's encoder that says no more than that, where it turns at about the commanded speed."""
    for command, name, turns in _encoders(key, guesses, signals, words):
        if 1.0 / NEAR < turns.slope < NEAR:
            return Guess(key, name, f"its rate {turns.words(command)}, and is about as large", 0.8)
    return None


def _encoders(
    key: str, guesses: Sequence[Guess], signals: Signals, words: Mapping[str, ColumnName]
) -> Iterator[tuple[str, str, SignalMatch]]:
    """The command, the column and how its rate follows the command, of columns that may be a wheel's encoder."""
    command = next((g.value for g in guesses if g.what == f"command.{member(key)}"), None)
    core = core_of(member(key))
    for name, w in words.items():
        if command is None or w.commanded or w.quantity not in (None, "position") or likeness(sides(w), core) < ALIKE:
            continue
        turns = signals.follows(command, name, answer_rate=True, levels=True)
        if turns.correlation > CLEAR:
            yield command, name, turns


def unused_columns(
    name: str, roles: Mapping[str, str], guesses: Sequence[Guess], signals: Signals, words: Mapping[str, ColumnName]
) -> tuple[Unmatched, ...]:
    """The columns without a role, and why; name: of the robot."""
    left = {n: w for n, w in words.items() if n in signals.names and n not in roles.values()}
    why = {n: f"{name} has nothing of this kind" for n in signals.names if n not in roles.values()}
    for wheel in ("left", "right"):
        for command, column, turns in _encoders(f"position.{wheel}", guesses, signals, left):
            if words[command].unit is None:  # a command in rpm differs from an encoder in rad as well
                many = f"its rate is {turns.slope:.3g} times {command}: possibly an encoder in other units"
                why[column] = f'{many}. Converted to rad, it can be used as "position.{wheel}"'
    return tuple(Unmatched(n, reason) for n, reason in why.items())
