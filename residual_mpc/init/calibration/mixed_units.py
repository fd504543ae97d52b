"""Runs of one robot that are logged in different units: no robot file can say so, and no correction fits them all."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.calibration.units import UnitGuess, find_units
from residual_mpc.init.columns.evidence import ColumnEvidence, Roles
from residual_mpc.init.columns.recording import Recording
from residual_mpc.init.columns.signals import gather
from residual_mpc.init.columns.time_column import Clock
from residual_mpc.init.columns.words import Quantity

SURE = 0.95  # of a column's unit in a single run, from which it counts
MOST = 24  # runs that are looked at, evenly chosen
THOUSANDS = 300.0  # times as long a step of the time, from which its unit is another one
REMEDY = "correct the runs that differ, or leave them out: one robot file describes runs in the same units"


def refuse_mixed_units(
    case: ColumnEvidence,
    recordings: Sequence[Recording],
    clock: Clock,
    roles: Roles,
    kinds: Mapping[str, Quantity],
) -> None:
    """Raises BadInput where a column is surely in one unit in one run, and surely in another one in another, or where
    the steps of the time are thousands of times as long."""
    if len(recordings) < 2:
        return
    _refuse_mixed_clocks(recordings, clock)
    found: dict[str, tuple[UnitGuess, Recording]] = {}
    for recording in recordings[:: -(-len(recordings) // MOST)]:
        for column, guess in _sure_units(case, recording, clock, roles, kinds).items():
            first, where = found.setdefault(column, (guess, recording))
            if first.unit is not guess.unit:
                what = f"in {guess.unit.name} here and in {first.unit.name} in {where.source}"
                raise BadInput(f"{column!r} appears to be {what}", str(recording.source), REMEDY)


def _refuse_mixed_clocks(recordings: Sequence[Recording], clock: Clock) -> None:
    stamps = [(np.diff(r.columns[clock.column]), r) for r in recordings if clock.column in r.columns]
    steps = [(float(np.nanmedian(np.abs(t))), r) for t, r in stamps if np.isfinite(t).any()]
    (shortest, one), (longest, other) = (of(steps, key=lambda s: s[0]) for of in (min, max))
    if longest > THOUSANDS * shortest > 0.0:
        steps_differ = f"a step of {clock.column!r} is {longest:.3g} here and {shortest:.3g} in {one.source}"
        raise BadInput(f"{steps_differ}: the units differ", str(other.source), REMEDY)


def _sure_units(
    case: ColumnEvidence, recording: Recording, clock: Clock, roles: Roles, kinds: Mapping[str, Quantity]
) -> dict[str, UnitGuess]:
    """By column that moves, its unit as this run alone shows it."""
    try:
        signals = gather([recording], clock)
    except BadInput:  # no two stamps: it says nothing
        return {}
    alone = replace(case, signals=signals)
    there = {n: c for n, c in roles.columns.items() if signals.moves(c)}
    guesses = find_units(alone, replace(roles, columns=there), kinds)
    return {c: g for c, g in guesses.items() if c in there.values() and g.sure >= SURE}
