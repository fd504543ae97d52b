"""Runs of one robot that are logged in different units: no robot file can say so, and no correction fits them all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.init.calibration.units import Unit, find_units
from residual_mpc.init.columns.evidence import ColumnEvidence, Roles, where_on
from residual_mpc.init.columns.recording import Recording
from residual_mpc.init.columns.signals import gather
from residual_mpc.init.columns.time_column import Clock
from residual_mpc.init.columns.words import Quantity
from residual_mpc.logs.signals import noise_sigma

SURE = 0.95  # of a column's unit in a single run, from which it counts
MOST = 24  # runs that are looked at, evenly chosen
NEAR = 4.0  # factor by which the ratio of the noise of two runs may differ from that of their units
STEPS = (1e3, 1e6, 1e9)  # ratios of ms, us and ns to each other and to s
REMEDY = "correct the runs that differ, or leave them out: one robot file describes runs in the same units"


@dataclass(frozen=True)
class RunUnit:
    """The unit of a column as one run alone shows it. sigma: 1-sigma noise of the column there, in that unit."""

    unit: Unit
    sigma: float
    recording: Recording

    def contradicts(self, other: "RunUnit") -> bool:
        """Whether the two differ, and the noise of the sensor differs as they do: in a run with little motion, degrees
        look like radians, but their noise stays what it is."""
        if self.unit is other.unit or not min(self.sigma, other.sigma) > 0.0:
            return False
        expected = other.unit.size / self.unit.size
        return bool(abs(np.log(self.sigma / other.sigma / expected)) < np.log(NEAR))


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
    found: dict[str, RunUnit] = {}
    for recording in recordings[:: -(-len(recordings) // MOST)]:
        for column, here in _sure_units(case, recording, clock, roles, kinds).items():
            first = found.setdefault(column, here)
            if here.contradicts(first):
                what = f"in {here.unit.name} here and in {first.unit.name} in {first.recording.source}"
                raise BadInput(f"{column!r} appears to be {what}", str(recording.source), REMEDY)


def _refuse_mixed_clocks(recordings: Sequence[Recording], clock: Clock) -> None:
    stamps = [(np.diff(r.columns[clock.column]), r) for r in recordings if clock.column in r.columns]
    each = [(float(np.nanmedian(np.abs(t))), r) for t, r in stamps if np.isfinite(t).any()]
    steps = [(step, r) for step, r in each if step > 0.0]
    if not steps:
        return
    (shortest, one), (longest, other) = (of(steps, key=lambda s: s[0]) for of in (min, max))
    if any(abs(np.log(longest / shortest / ratio)) < np.log(2.0) for ratio in STEPS):
        steps_differ = f"a step of {clock.column!r} is {longest:.3g} here and {shortest:.3g} in {one.source}"
        raise BadInput(f"{steps_differ}: the units differ", str(other.source), REMEDY)


def _sure_units(
    case: ColumnEvidence, recording: Recording, clock: Clock, roles: Roles, kinds: Mapping[str, Quantity]
) -> dict[str, RunUnit]:
    """By column that moves, its unit as this run alone shows it."""
    try:
        signals = gather([recording], clock)
    except BadInput:  # no two stamps: it says nothing
        return {}
    there = {n: c for n, c in roles.columns.items() if c in signals.raw and signals.moves(c)}
    own = replace(roles, columns=there)
    guesses = find_units(where_on(replace(case, signals=signals), own), own, kinds)
    sure = {c: g.unit for c, g in guesses.items() if c in there.values() and g.sure >= SURE}
    t = signals.dt * np.arange(len(signals.run))
    return {c: RunUnit(unit, noise_sigma(t, signals.raw[c]), recording) for c, unit in sure.items()}
