"""The numbers of a robot's actuators, effects included; optional for a robot."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from residual_mpc.models.settings import Settings


@dataclass(frozen=True)
class ActuatorValues:
    """One actuator, at its joint: rad, N m where that turns; m, N where it slides.

    Attributes:
        kind: "position", "velocity" or "torque": what its command is.
        gear: the command of a position servo is this many times the joint's position.
        stiffness: N m/rad of a position servo, else 0. damping: N m s/rad of the servo.
        armature: kg m^2. friction: dry, N m. viscous_friction: N m s/rad, of the joint itself.
        effort_limit: N m, None without.
        delay: s of dead time before the actuator. lag: s, time constant of its first-order filter.
        gain: N m at the joint per unit of the command.
    """

    actuator: str
    joint: str
    kind: str
    gear: float
    stiffness: float
    damping: float
    armature: float
    friction: float
    viscous_friction: float
    effort_limit: float | None
    delay: float
    lag: float
    gain: float


@runtime_checkable
class ListsActuators(Protocol):
    @property
    def step(self) -> float: ...

    def actuator_values(self, settings: Settings) -> tuple[ActuatorValues, ...]:
        """settings: one row; what is no value of an actuator is left out."""
        ...

    def not_of_actuators(self, settings: Settings) -> tuple[str, ...]:
        """What is left out, each with where it belongs."""
        ...
