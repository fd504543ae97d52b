"""Whether a column was sent to an actuator: its command, or the switch that turns it on."""

from __future__ import annotations

from functools import partial

import numpy as np

from residual_mpc.init.assign import NEVER, Odds, Rule
from residual_mpc.init.case import Case, Driven, Roles
from residual_mpc.init.signals import CLEAR, NOTHING, Seen
from residual_mpc.init.words import Words, called


def commands(case: Case, roles: Roles) -> dict[str, Rule]:
    return {f"command.{d.name}": partial(_command, case, roles, i, d) for i, d in enumerate(case.driven)}


def _command(case: Case, roles: Roles, member: int, driven: Driven, words: Words) -> Odds:
    if words.quantity in ("acceleration", "enabled", "other") or words.measured and not words.commanded:
        return NEVER, ()
    if not np.isfinite(case.signals.raw[words.name]).any():
        return NEVER, ()
    whose, why = case.actuators.evidence(words, member)
    odds, reasons = whose, [why]
    if words.commanded:
        odds, reasons = odds + 3.0, [*reasons, f"its name says command ({called(words, 'command')})"]
    if words.quantity is not None and driven.kind is not None:
        same = words.quantity == driven.kind
        odds += 1.5 if same else -2.5
        reasons.append(f"it is a {driven.kind}, as the actuator takes" if same else "")
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
            seen.append((s.follows(column, position, answer_rate=True, levels=True), f"the derivative of {position}"))
    return max(seen, key=lambda x: abs(x[0].correlation), default=(NOTHING, ""))


def switches(case: Case) -> dict[str, Rule]:
    return {f"enabled.{d.name}": partial(_switch, case, i) for i, d in enumerate(case.driven)}


def _switch(case: Case, member: int, words: Words) -> Odds:
    x = case.signals.raw[words.name]
    x = x[np.isfinite(x)]
    if words.quantity != "enabled" or not len(x) or np.isin(x, (0.0, 1.0)).mean() < 0.9:
        return NEVER, ()
    whose, why = case.actuators.evidence(words, member)
    return whose + 2.0, (why, "its name says switch, and it is 0 or 1")
