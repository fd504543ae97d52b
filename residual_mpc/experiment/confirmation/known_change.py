"""What the user changed on the robot before the new runs, by a known amount."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import TUNE, Knob, Term, Values


@dataclass(frozen=True)
class KnownChange:
    """knob: the number that was changed, in its own unit; amount: its new value, or what was added to it if `relative`;
    None: the effect was removed from the robot."""

    knob: Knob
    amount: float | None
    relative: bool = False

    @property
    def term(self) -> Term:
        return self.knob.term

    def of(self, value: float) -> float:
        """The number after the change, from what it was before."""
        if self.amount is None:
            return BY_NAME[self.knob.effect].parameter(self.knob.parameter).null
        return value + self.amount if self.relative else self.amount


def read_change(text: str, named: Sequence[Term], slots: Mapping[str, tuple[str, ...]]) -> KnownChange:
    """EFFECT[.PARAMETER][@TARGET] followed by =VALUE, +=VALUE, -=VALUE or =none.

    named: the effects of the diagnosis, among which a target that is not given is looked up; slots: the robot's targets
    for each effect. Raises BadInput for anything else, and for what the robot or the effect does not have.
    """
    where = f"--changed {text}"
    left, equals, right = text.partition("=")
    sign = left[-1:] if left[-1:] in "+-" else ""
    name, _, target = left.removesuffix(sign).strip().partition("@")
    name, _, parameter = name.partition(".")
    effect = BY_NAME.get(name)
    if not equals or effect is None or not effect.fitted:
        known = f"unknown effect {name!r}" if equals else "there is no '='"
        raise BadInput(known, where, "write EFFECT=VALUE, EFFECT+=VALUE or EFFECT=none, such as payload+=0.2")
    amount = _amount(right.strip(), sign, where)
    sizes = [p.name for p in effect.parameters if not p.shape and not p.optional]
    if not parameter and (amount is None or len(sizes) == 1):
        parameter = sizes[0]
    if parameter not in {p.name for p in effect.parameters}:
        raise BadInput(
            f"{name} has no parameter {parameter!r}" if parameter else f"{name} has several parameters",
            where,
            f"write {name}.PARAMETER with one of {', '.join(p.name for p in effect.parameters)}",
        )
    term = Term(name, _target(name, target, named, slots, where))
    if sign and math.isinf(effect.parameter(parameter).null) and term not in named:
        raise BadInput(f"the diagnosis names no {parameter} to change by an amount", where, f"write {name}=VALUE")
    return KnownChange(Knob(name, term.target, parameter), amount, bool(sign))


def _amount(text: str, sign: str, where: str) -> float | None:
    if text == "none" and not sign:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"the value must be a number or 'none', got {text!r}", where, "give it in the effect's unit")
    return -value if sign == "-" else value


def _target(
    effect: str, given: str, named: Sequence[Term], slots: Mapping[str, tuple[str, ...]], where: str
) -> str | None:
    """The target; without one the only one that the diagnosis names, else the robot as a whole."""
    if given:
        if given not in slots[effect]:
            there = ", ".join(slots[effect]) or "none on this robot"
            raise BadInput(f"{effect} has no target {given!r}", where, f"the targets are {there}")
        return given
    mine = [t for t in named if t.effect == effect]
    if len(mine) > 1:
        raise BadInput(
            f"the diagnosis names {effect} of {' and '.join(str(t.target) for t in mine)}", where,
            f"write {effect}@TARGET",
        )  # fmt: skip
    return mine[0].target if mine else None


def changed_values(values: Values, changes: Sequence[KnownChange]) -> dict[Knob, float]:
    """The values of a model after the changes; an effect that does nothing any more is left out."""
    out = dict(values)
    for change in changes:
        if change.amount is None:
            out = {k: v for k, v in out.items() if k.effect == TUNE or k.term != change.term}
            continue
        for p in BY_NAME[change.knob.effect].parameters:
            if not p.optional:
                out.setdefault(Knob(change.knob.effect, change.knob.target, p.name), p.null)
        null = BY_NAME[change.knob.effect].parameter(change.knob.parameter).null
        out[change.knob] = change.of(out.get(change.knob, null))
    return out
