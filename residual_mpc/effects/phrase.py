"""How a report states an effect: one clause, for arms and for robots that drive; and what its parameters are called."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

# How a target is called, by the kind of target.
TARGETS = {"actuator": "actuator", "joint": "joint", "body": "link", "channel": "channel", "robot": ""}
WHEELS = {"left": "the left wheel", "right": "the right wheel"}
EVERYONE = {
    "actuator": "every actuator",
    "joint": "every joint",
    "body": "every link",
    "channel": "every channel",
    "robot": "the robot",
}


def called(noun: str, name: object) -> str:
    """ "joint elbow"; a name that begins with the noun alone, such as "joint2"."""
    return str(name) if str(name).lower().startswith(noun) else f"{noun} {name}"


@dataclass(frozen=True)
class Phrase:
    """`text` names the parameters in braces; {who}: the target; {quantity}: what a limit's unit measures."""

    text: str
    everyone: str = ""  # in place of a target where there is none; else by EVERYONE
    someone: str = ""  # how the target is called, where that differs from TARGETS
    located: str = ""  # what follows where optional numbers are stated; {where} lists these
    # of each optional number its words, such as "80 mm along x", from its {value} and, of one per unit, that unit {per}
    optional: Mapping[str, str] = field(default_factory=dict)
    shares: tuple[str, ...] = ()  # parameters that read better as a percentage
    by_unit: Mapping[str, str] = field(default_factory=dict)  # unit -> the text in place of `text`
    # of a number that `text` does not name, the text in its place where this number alone is clearly there
    instead: Mapping[str, str] = field(default_factory=dict)

    def who(self, target: str | None, kind: str) -> str:
        """The target, as the clause names it. kind: of target, a key of TARGETS."""
        if not target:
            return self.everyone or EVERYONE[kind]
        if target in WHEELS and not self.someone:
            return WHEELS[target]
        if not self.someone:
            return called(TARGETS[kind], target)
        return self.someone.format(WHEELS.get(target, target))


@dataclass(frozen=True)
class Noun:
    """What a parameter is called where its value before and after are compared.

    text: as it follows "the"; targeted: the shorter one before "of" and a target.

    kind: `own`, of something that the model lacks and that may appear or disappear; `excess`, what a quantity has more
    than the model says; `factor`, of what the model says; `ratio`, of two quantities of the robot. Where it appears or
    disappears: appears: what, if not the noun; article: the one that it takes; size: what its number is called, if that
    needs saying; inside: the preposition before the target."""

    text: str
    kind: Literal["own", "excess", "factor", "ratio"] = "own"
    appears: str = ""
    article: str = "a"
    size: str = ""
    inside: str = "of"
    targeted: str = ""
