"""Whom a column's name means: which joint, which actuator, by words or by number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from residual_mpc.init.columns.words import KNOWN, ColumnName, core_of, likeness, tokens

NAMED = 0.5  # likeness from which a name counts as said
BY_NAME, BY_NUMBER, BY_ORDER = 4.0, 3.0, 0.4  # log odds
SOMEONE_ELSE, STRANGER = -4.0, -0.5


@dataclass(frozen=True)
class Members:
    """What may be named. aliases[i]: the names under which the i-th is known (a joint, and the actuators on it).

    numbers: for each column that names its member by a number alone, which member that is. order: the place of each
    column among those of its kind.
    """

    aliases: tuple[tuple[str, ...], ...]
    numbers: Mapping[str, int]
    order: Mapping[str, int]

    def evidence(self, words: ColumnName, member: int) -> tuple[float, str]:
        """(log odds that the column is the member's, why)."""
        if len(self.aliases) == 1:
            return 1.0, "the robot has only one"
        if words.name in self.numbers:
            if self.numbers[words.name] != member:
                return SOMEONE_ELSE, ""
            return BY_NUMBER, f"its number matches {self.aliases[member][0]}"
        likes = [max(_like(words, alias) for alias in each) for each in self.aliases]
        mine, best = likes[member], max(likes)
        if mine >= NAMED and mine >= best - 0.01:
            shared = sum(like >= best - 0.01 for like in likes)
            return BY_NAME * mine / shared, f"its name resembles {self.aliases[member][0]}"
        if best >= 0.75 and mine < best - 0.15:
            return SOMEONE_ELSE, ""
        if mine >= NAMED:
            return BY_NAME * mine - 2.0, f"its name vaguely resembles {self.aliases[member][0]}"
        stranger = STRANGER if words.core else 0.0
        here = self.order.get(words.name) == member
        return stranger + (BY_ORDER if here else 0.0), "only the order of the columns" if here else ""


def members_of(aliases: Sequence[Sequence[str]], columns: Sequence[ColumnName]) -> Members:
    """The members, and what the columns' numbers mean: they may count from 0, from 1, or as the names do."""
    own = [next((int(w) for w in core_of(each[0]) if w.isdigit()), None) for each in aliases]
    all_numbered = all(n is not None and core_of(each[0]) == (str(n),) for n, each in zip(own, aliases, strict=True))
    groups: dict[tuple[object, ...], list[ColumnName]] = {}
    for words in columns:
        groups.setdefault((words.commanded, words.measured, words.quantity), []).append(words)
    numbers: dict[str, int] = {}
    order: dict[str, int] = {}
    for group in groups.values():
        order |= {words.name: i for i, words in enumerate(group)}
        counted = {w.name: int(w.core[0]) for w in group if len(w.core) == 1 and w.core[0].isdigit()}
        if not counted:
            continue
        if all_numbered and set(counted.values()) <= set(own):
            numbers |= {name: own.index(k) for name, k in counted.items()}
        elif max(counted.values()) - min(counted.values()) < len(aliases):
            base = min(counted.values()) if min(counted.values()) in (0, 1) else None
            if base is not None:
                numbers |= {name: k - base for name, k in counted.items()}
    return Members(tuple(tuple(each) for each in aliases), numbers, order)


def _like(words: ColumnName, alias: str) -> float:
    core = core_of(alias)
    if set(core) <= KNOWN:  # an actuator called `servo`
        return 1.0 if set(tokens(alias)) <= set(words.every) else 0.0
    return likeness(words.core, core)
