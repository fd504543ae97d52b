"""An arm as its program has it: links, actuators, tendons, limits, and where the numbers of a row lie in memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from plants.mujoco_robot.native.dynamics import Joint, LinkNumbers
from plants.mujoco_robot.native.lanes import Lanes, load
from plants.mujoco_robot.native.program import Program, Value

Integrator = Literal["Euler", "implicitfast", "RK4"]


@dataclass(frozen=True)
class Actuator:
    """joint: that it drives; gear: torque there per unit of its force; clamp: range of its command, None without one;
    limited: whether its force has a range."""

    joint: int
    gear: float
    clamp: tuple[float, float] | None
    limited: bool


@dataclass(frozen=True)
class Stop:
    """How a joint's limits push back. margin: rad or m; solimp: of the impedance, clipped."""

    margin: float
    solimp: tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Tendon:
    """A length, the sum of joint positions times the coefficients in `of`, with a spring that has a dead band; stop: of
    its limits, None without any; rubs: whether it has dry friction."""

    of: tuple[tuple[int, float], ...]
    stop: Stop | None
    rubs: bool = False


@dataclass(frozen=True)
class Equality:
    """A joint that follows another: its way from the drawn posture is begin + slope times that of the other one, or
    begin alone without one. solimp: of the impedance, clipped."""

    joint: int
    other: int | None
    begin: float
    slope: float
    solimp: tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Chain:
    """An arm as the program has it, the same for all rows and any time step. integrator: the damping of the joints is
    implicit in Euler, that of servos as well in implicitfast, and none in RK4; drawn: joint positions in the drawn
    posture; reach: of the torque of all of a joint's actuators. rubs: whether joints have dry friction; stops: of
    joints with limits."""

    integrator: Integrator
    drawn: tuple[float, ...]
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    reach: tuple[tuple[float, float] | None, ...]
    rubs: bool
    stops: tuple[Stop | None, ...]
    tendons: tuple[Tendon, ...]
    equalities: tuple[Equality, ...] = ()


ARM = 4  # numbers of an arm: time step, gravity 3
LINK = 13  # of a link: place 3, mass, centre 3, inertia 6
# of a joint: armature, damping, stiffness, spring's rest, friction, its 1/R and B, lower and upper limit, their K and
# B, inverse weight, torque beside the actuators'
JOINT = 13
DAMPING, FRICTION, BESIDE = 1, 4, 12  # where among them are those that change between steps
ACTUATOR = 6  # of an actuator: gain, bias 3, range 2
# of a tendon: stiffness, ends of the dead band, lower and upper limit, their K and B, inverse weight, damping, dry
# friction, its 1/R and B
TENDON = 12
DAMPS = 8  # where among them is the damping
EQUALITY = 3  # of a joint that follows another: K and B, inverse weight


def sizes(chain: Chain) -> int:
    """Numbers of a row."""
    return equality_at(chain, len(chain.equalities))


def joint_at(chain: Chain, i: int) -> int:
    """Where a joint's numbers begin."""
    return ARM + LINK * len(chain.joints) + JOINT * i


def actuator_at(chain: Chain, i: int) -> int:
    """Where an actuator's numbers begin."""
    return joint_at(chain, len(chain.joints)) + ACTUATOR * i


def tendon_at(chain: Chain, i: int) -> int:
    """Where a tendon's numbers begin."""
    return actuator_at(chain, len(chain.actuators)) + TENDON * i


def equality_at(chain: Chain, i: int) -> int:
    """Where an equality's numbers begin."""
    return tendon_at(chain, len(chain.tendons)) + EQUALITY * i


@dataclass(frozen=True, eq=False)
class Row:
    """The numbers of the rows, as they lie in memory."""

    p: Program
    array: Value
    chain: Chain

    @property
    def step(self) -> Lanes:
        return self._load(0)

    @property
    def gravity(self) -> tuple[Lanes, Lanes, Lanes]:
        return self._load(1), self._load(2), self._load(3)

    def link(self, i: int) -> LinkNumbers:
        at = ARM + LINK * i
        place, centre = ((self._load(at + k), self._load(at + k + 1), self._load(at + k + 2)) for k in (0, 4))
        return LinkNumbers(place, self._load(at + 3), centre, tuple(self._load(at + 7 + k) for k in range(6)))

    def joint(self, i: int) -> list[Lanes]:
        at = joint_at(self.chain, i)
        return [self._load(at + k) for k in range(JOINT)]

    def actuator(self, i: int) -> list[Lanes]:
        at = actuator_at(self.chain, i)
        return [self._load(at + k) for k in range(ACTUATOR)]

    def tendon(self, i: int) -> list[Lanes]:
        at = tendon_at(self.chain, i)
        return [self._load(at + k) for k in range(TENDON)]

    def equality(self, i: int) -> list[Lanes]:
        at = equality_at(self.chain, i)
        return [self._load(at + k) for k in range(EQUALITY)]

    def _load(self, at: int) -> Lanes:
        return load(self.p, self.array, at)
