"""Known changes that the user made to the robot before the new runs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from residual_mpc.effects.effect import Effect
from residual_mpc.effects.library import BY_NAME
from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Knob, Term, Values


@dataclass(frozen=True)
class KnownChange:
    """knob: the parameter that was changed; amount: its new value, or the increment if `relative`, in the unit of the
    parameter; None if the effect was removed."""

    knob: Knob
    amount: float | None
    relative: bool = False

    @property
    def term(self) -> Term:
        return self.knob.term

    def of(self, value: float) -> float:
        """The value after the change, given the value before."""
        if self.amount is None:
            return BY_NAME[self.knob.effect].parameter(self.knob.parameter).null
        return value + self.amount if self.relative else self.amount


def check_change(text: str, slots: Mapping[str, tuple[str, ...]]) -> None:
    """Raises BadInput for a change that no diagnosis could give a meaning, see `read_change`."""
    _parsed(text, slots)


def read_change(text: str, named: Sequence[Term], slots: Mapping[str, tuple[str, ...]]) -> KnownChange:
    """Parse EFFECT[.PARAMETER][@TARGET] followed by =VALUE, +=VALUE, -=VALUE or =none.

    named: the effects of the diagnosis, from which an omitted target is taken; slots: the targets of each effect on
    this robot. Raises BadInput for any other syntax and for an unknown effect, parameter or target.
    """
    where = f"`changed={text}`"
    effect, parameter, given, sign, amount = _parsed(text, slots)
    term = Term(effect.name, _target(effect, given, named, slots, where))
    there = term in named or term._replace(target=None) in named
    if sign and math.isinf(effect.parameter(parameter).null) and not there:
        raise BadInput(
            f"the diagnosis gives no {parameter} to add to or subtract from", where, f"write {effect.name}=VALUE"
        )
    return KnownChange(Knob(effect.name, term.target, parameter), amount, bool(sign))


def _parsed(text: str, slots: Mapping[str, tuple[str, ...]]) -> tuple[Effect, str, str, str, float | None]:
    """Effect, parameter, target (empty for none), sign of an increment (empty for a value) and amount."""
    where = f"`changed={text}`"
    left, equals, right = text.partition("=")
    sign = left[-1:] if left[-1:] in ("+", "-") else ""
    name, _, target = left.removesuffix(sign).strip().partition("@")
    name, _, parameter = name.partition(".")
    effect = BY_NAME.get(name)
    if not equals or effect is None or not effect.fitted or not slots.get(name):
        said = f"unknown effect {name!r}" if equals else "the change has no '='"
        if equals and effect is not None:
            said = f"{name} {'does not exist on this robot' if effect.fitted else 'has no parameter to change'}"
        raise BadInput(said, where, "write EFFECT=VALUE, EFFECT+=VALUE, EFFECT-=VALUE or EFFECT=none, as payload+=0.2")
    amount = _amount(right.strip(), sign, where)
    sizes = [p.name for p in effect.parameters if not p.shape and not p.optional]
    if not parameter and (amount is None or len(sizes) == 1):
        parameter = sizes[0]
    if parameter not in {p.name for p in effect.parameters}:
        raise BadInput(
            f"{name} has no parameter {parameter!r}" if parameter else f"{name} has several parameters",
            where,
            f"write {name}.PARAMETER, where PARAMETER is one of {', '.join(p.name for p in effect.parameters)}",
        )
    if target and target not in slots[name]:
        raise BadInput(
            f"{name} has no target {target!r} on this robot", where, f"the targets are {', '.join(slots[name])}"
        )
    return effect, parameter, target, sign, amount


def _amount(text: str, sign: str, where: str) -> float | None:
    if text == "none" and not sign:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        wanted = "a number" if sign else "a number or 'none'"
        raise BadInput(f"the value must be {wanted}, got {text!r}", where, "give it in the unit of the parameter")
    return -value if sign == "-" else value


def _target(
    effect: Effect, given: str, named: Sequence[Term], slots: Mapping[str, tuple[str, ...]], where: str
) -> str | None:
    """The given target; if none is given, the only one that the diagnosis names for this effect, or else None (all
    targets together). The only target of a robot is None if the diagnosis calls it so."""
    mine = [t.target for t in named if t.effect == effect.name]
    if given:
        return None if mine == [None] and len(slots[effect.name]) == 1 else given
    if len(mine) > 1 or (not mine and not effect.null_target and len(slots[effect.name]) > 1):
        names = " and ".join("all targets" if t is None else t for t in mine or slots[effect.name])
        several = "the diagnosis names it for several targets" if mine else "it has several targets on this robot"
        raise BadInput(f"{several} ({names})", where, f"write {effect.name}@TARGET to select one")
    if not mine and not effect.null_target:
        return slots[effect.name][0]
    return mine[0] if mine else None


def check_possible(changes: Sequence[KnownChange], values: Values, robot: Robot) -> None:
    """Raises BadInput for a change that gives a parameter a value that it cannot have. values: before the changes."""
    after = changed_values(values, changes)
    for change in changes:
        if change.knob not in after:
            continue
        p, value = BY_NAME[change.knob.effect].parameter(change.knob.parameter), after[change.knob]
        low, high = robot.bounds(change.knob.effect, change.knob.parameter, change.knob.target)
        if not max(low, p.lower) <= value <= min(high, p.upper):
            raise BadInput(
                f"{change.knob.parameter} would be {value:g}, which is outside {max(low, p.lower):g} to "
                f"{min(high, p.upper):g}", f"`changed={change.knob.effect}`", f"give it in the unit {p.unit}",
            )  # fmt: skip


def changed_values(values: Values, changes: Sequence[KnownChange]) -> dict[Knob, float]:
    """The parameters of a model after the changes; a removed effect is dropped."""
    out = dict(values)
    for change in changes:
        effect, term = BY_NAME[change.knob.effect], change.term
        of_all = {k.parameter: v for k, v in out.items() if k.effect != TUNE and k.term == term._replace(target=None)}
        if change.amount is None and (term.target is None or not of_all):
            out = {k: v for k, v in out.items() if k.effect == TUNE or k.term != term}
            continue
        for p in effect.parameters:  # one target of an effect on all of them begins where these are
            if not p.optional or p.name in of_all:
                start = p.null if change.amount is None else of_all.get(p.name, p.null)
                out.setdefault(Knob(term.effect, term.target, p.name), start)
        out[change.knob] = change.of(out[change.knob])
    return out
