"""Whether a column that no name calls a velocity is one: it goes like its position's rate, in a unit that there is."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

from residual_mpc.init.calibration.units import ANGLES, LENGTHS, RATES, SPEEDS, Unit
from residual_mpc.init.columns.evidence import ColumnEvidence
from residual_mpc.models.model_structure import Joint

ALIKE = 0.9  # correlation of a velocity with the rate of its position
AT_ONCE = 0.1  # s between them
OFF = 0.05  # of a unit's size: how far a slope may lie from it, beside what noise takes away
USUAL = 1.0  # prior of two units together from which they are looked for
MOST = 2.0 / 3.0  # of the joints: who logs velocities logs them of nearly all, in one unit


def velocity_columns(case: ColumnEvidence, positions: Mapping[str, str]) -> frozenset[str]:
    """The columns of unknown quantity that are velocities by their data.

    A torque goes like its joint's speed too where friction rules, and with luck about as many times as there are
    degrees in a radian; but hardly so at two joints out of three.

    Args:
        positions: joint -> column.
    """
    of: dict[float, dict[str, set[str]]] = {}  # ratio -> joint -> columns
    moving = [j for j in case.structure.joints if j.name in positions and case.signals.moves(positions[j.name])]
    for joint in moving:
        for column, ratio in _rates(case, joint, positions):
            of.setdefault(ratio, {}).setdefault(joint.name, set()).add(column)
    enough = MOST * len(moving)
    return frozenset(c for joints in of.values() if len(joints) >= enough for mine in joints.values() for c in mine)


def _rates(case: ColumnEvidence, joint: Joint, positions: Mapping[str, str]) -> list[tuple[str, float]]:
    """Columns that go like the rate of a joint's position, each with the ratio of units that explains its size."""
    member, position, taken = case.structure.joints.index(joint), positions[joint.name], set(positions.values())
    found = []
    for column, words in case.words.items():
        if column in taken or words.quantity is not None or case.joints.evidence(words, member)[0] <= -1.0:
            continue
        seen = case.signals.follows(position, column, source_rate=True)
        r, slope = abs(seen.correlation), abs(seen.slope)
        if r < ALIKE or abs(seen.lag) > AT_ONCE:
            continue
        # noise of the rate takes from the slope up to its share of the rate's power
        low, high = slope * (1.0 - OFF), slope * (1.0 + OFF) / r**2
        found += [(column, ratio) for ratio in _ratios(case, joint, position, column) if low < ratio < high]
    return found


def _ratios(case: ColumnEvidence, joint: Joint, position: str, column: str) -> set[float]:
    """How many times the rate of a position a velocity may be, by the units that logs are usually in."""
    places, rates = (LENGTHS, RATES) if joint.slides else (ANGLES, SPEEDS)
    fitting = product(_possible(case, places, position), _possible(case, rates, column))
    return {round(p.size / r.size, 9) for p, r in fitting if p.prior + r.prior >= USUAL}


def _possible(case: ColumnEvidence, units: tuple[Unit, ...], column: str) -> list[Unit]:
    """Whole numbers count, and only whole numbers do."""
    return [u for u in units if not u.counts or column in case.signals.whole]
