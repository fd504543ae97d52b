"""Whether a column was sent to an actuator: its command, or the switch that turns it on."""

from __future__ import annotations

from functools import partial

import numpy as np

from residual_mpc.init.columns.evidence import ColumnEvidence, JointDrive, Roles, joint_response
from residual_mpc.init.columns.signals import CLEAR, NOTHING
from residual_mpc.init.columns.words import ColumnName, called
from residual_mpc.init.roles.assignment import NEVER, Odds, Rule


def commands(case: ColumnEvidence, roles: Roles) -> dict[str, Rule]:
    return {f"command.{d.name}": partial(_command, case, roles, i, d) for i, d in enumerate(case.driven)}


def _command(case: ColumnEvidence, roles: Roles, member: int, driven: JointDrive, words: ColumnName) -> Odds:
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
        article = "an" if driven.kind == "effort" else "a"
        reasons.append(f"it is {article} {driven.kind}, as the actuator takes" if same else "")
    elif words.quantity is not None and not words.commanded:
        odds -= 1.0
    seen, what = joint_response(case, roles, words.name, driven)
    r = abs(seen.correlation)
    if r > 0.5:
        odds += 4.0 * r * r - (1.5 if seen.lag < -2.0 * case.signals.dt else 0.0)
        reasons.append(f"{what} {seen.words('it')}")
    elif seen is not NOTHING and r < 0.2:
        odds -= 1.0
    if words.quantity == driven.kind == "effort" and not words.commanded:
        # a torque is logged as a command and as a measurement, and under gravity it says little of the motion
        odds -= 1.5
        reasons.append("its name does not say that it was measured")
    elif not words.commanded and r < (0.7 if words.kind else CLEAR):
        return NEVER, ()
    return odds, tuple(reasons)


def switches(case: ColumnEvidence) -> dict[str, Rule]:
    return {f"enabled.{d.name}": partial(_switch, case, i) for i, d in enumerate(case.driven)}


def _switch(case: ColumnEvidence, member: int, words: ColumnName) -> Odds:
    x = case.signals.raw[words.name]
    x = x[np.isfinite(x)]
    if words.quantity != "enabled" or not len(x) or np.isin(x, (0.0, 1.0)).mean() < 0.9:
        return NEVER, ()
    whose, why = case.actuators.evidence(words, member)
    return whose + 2.0, (why, "its name says switch, and it is 0 or 1")
