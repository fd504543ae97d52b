"""Which column is what: names and data weighed as log odds, and every column given to one role at most."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from residual_mpc.init.columns.evidence import ColumnEvidence, Roles
from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.roles.assignment import Rule, assign
from residual_mpc.init.roles.commands import commands, switches
from residual_mpc.init.roles.measurements import efforts, positions, velocities

ORDER = 0.3  # how sure, where nothing but the order of the columns tells joints apart


def find_roles(case: ColumnEvidence) -> Roles:
    """Positions first, then what relates to them: velocities, commands, efforts, switches."""
    roles = _with(case, positions(case), Roles({}))
    roles = _with(case, velocities(case, roles), roles)
    roles = _with(case, commands(case, roles), roles)
    roles = _with(case, efforts(case), roles)
    return _no_surer(case, _with(case, switches(case), roles))


def _with(case: ColumnEvidence, rules: Mapping[str, Rule], roles: Roles) -> Roles:
    """`roles`, and more among the columns that are free."""
    used = set(roles.columns.values())
    guesses = assign(rules, (w for n, w in case.words.items() if n not in used))
    return roles.plus(Roles({g.what: g.value for g in guesses}, guesses))


def _no_surer(case: ColumnEvidence, roles: Roles) -> Roles:
    """Joints told apart by the order of the columns alone are hardly told apart, nor is what goes with them."""
    joints = [j.name for j in case.structure.joints]
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
