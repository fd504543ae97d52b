"""What the runs refute of a model: stops and limits that its robot went beyond, and shapes that overlap.

Replayed against a stop, a limit or a contact that the robot does not have, a model is pushed aside, which looks like
another load, length or gain. All commands therefore use the model without them, and say so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from residual_mpc.logs.audit.ranges import COMMAND, JOINT, PassedRange, passed_ranges, ranges_by_name
from residual_mpc.logs.columns import group, member
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.facts import facts_of
from residual_mpc.models.protocol import Robot

ROWS = 400  # of all runs together, at which shapes are placed
DEEP = 0.005  # m that shapes of the robot may overlap: models round theirs, and contacts are soft
DEEP_IN_WORLD = 0.02  # m, where the robot may have been pressed against something
OFTEN = 2  # of these rows


@dataclass(frozen=True)
class Overlap:
    """Two bodies whose shapes overlap where the robot was measured; what does not move is "". depth: m, the most; run,
    row: where that is."""

    bodies: tuple[str, str]
    depth: float
    run: str
    row: int

    def finding(self) -> Finding:
        """The warning."""
        one, other = (body or "world" for body in self.bodies)
        return Finding(
            "warning", "overlapping shapes", self.run, "", self.row,
            f"the shapes of {one} and {other} overlap by up to {1000.0 * self.depth:.0f} mm where the robot was "
            "measured: the model is used without contact between them",
            f'add <exclude body1="{one}" body2="{other}"/> to <contact> in the model file; if they do touch, check the '
            "zeros and signs of the joints",
        )  # fmt: skip


@dataclass(frozen=True)
class Refuted:
    """ranges: that the runs went beyond; overlaps: of shapes that the model has collide."""

    ranges: tuple[PassedRange, ...] = field(default=())
    overlaps: tuple[Overlap, ...] = field(default=())

    def without(self, robot: Robot) -> Robot:
        """The robot without what is refuted; one that cannot be changed so is returned as it is."""
        if self.ranges:
            joints, commands = (ranges_by_name(self.ranges, of) for of in (JOINT, COMMAND))
            robot = optional.with_ranges(robot, joints, commands)
        return optional.without_contacts(robot, [o.bodies for o in self.overlaps]) if self.overlaps else robot


NOTHING = Refuted()


def refuted_by(robot: Robot, runs: Sequence[Run]) -> Refuted:
    """What these runs of a robot refute of its nominal model."""
    ranges = passed_ranges(runs, facts_of(robot))
    return Refuted(ranges, _overlaps(robot, runs))


def _overlaps(robot: Robot, runs: Sequence[Run]) -> tuple[Overlap, ...]:
    """Shapes that overlap at some of the measured positions."""
    worst: dict[tuple[str, str], Overlap] = {}
    often: dict[tuple[str, str], int] = {}
    for run in runs:
        rows = np.unique(np.linspace(0, len(run.t) - 1, max(ROWS // len(runs), OFTEN)).round().astype(int))
        measured = {member(c): run.columns[c][rows] for c in run.measured if group(c) == "position"}
        for bodies, depth in optional.overlaps(robot, measured).items():
            deep = depth > (DEEP if all(bodies) else DEEP_IN_WORLD)
            often[bodies] = often.get(bodies, 0) + int(deep.sum())
            at = int(np.argmax(depth))
            if deep.any() and (bodies not in worst or depth[at] > worst[bodies].depth):
                worst[bodies] = Overlap(bodies, float(depth[at]), run.name, int(rows[at]))
    return tuple(o for bodies, o in worst.items() if often[bodies] >= OFTEN)
