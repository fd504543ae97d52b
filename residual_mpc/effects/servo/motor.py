"""A brushed DC motor behind a gear, described at the joint.

Fitzgerald, Kingsley and Umans, Electric Machinery, 2003, section 7.4, at a duty cycle d of the supply V and without the
inductance, whose time constant is far below that of the motion:

    i = (d V - kt w) / R,   torque = kt i = kt V / R * d - kt^2 / R * w
"""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Motor:
    """The constants of one actuator.

    Attributes:
        voltage: V, of the supply.
        resistance: ohm, from terminal to terminal, the driver's and the cable's included.
        torque_constant: N m/A at the joint, after the gear; in SI units also the back-EMF constant, V s/rad.
        p_gain: value of the servo's P register, None where it is not stated.
        duty_per_rad: duty cycle (1 is full voltage) per radian of position error and unit of the P register; None where
            the firmware's law is not known.
        servo: name in the table of published figures, empty where the constants were given one by one.

    Raises ValueError for a constant that is not positive.
    """

    voltage: float
    resistance: float
    torque_constant: float
    p_gain: float | None = None
    duty_per_rad: float | None = None
    servo: str = ""

    def __post_init__(self) -> None:
        numbers = (self.voltage, self.resistance, self.torque_constant, self.p_gain, self.duty_per_rad)
        if not all(x is None or x > 0.0 for x in numbers):
            raise ValueError(f"the constants of a motor must be > 0, got {numbers}")

    @property
    def stall_torque(self) -> float:
        """N m, at full voltage and standstill."""
        return self.torque_constant * self.voltage / self.resistance

    @property
    def no_load_speed(self) -> float:
        """rad/s, at full voltage without friction or load."""
        return self.voltage / self.torque_constant

    @property
    def damping(self) -> float:
        """N m s/rad, by which the back-EMF brakes the joint."""
        return self.torque_constant**2 / self.resistance

    @property
    def stiffness(self) -> float | None:
        """N m/rad, of the position loop; None where the P register or its law is not known."""
        if self.p_gain is None or self.duty_per_rad is None:
            return None
        return self.stall_torque * self.p_gain * self.duty_per_rad


Across = tuple[float, tuple[float, float] | None]  # a number with its 95 % interval


def mapped(law: Callable[..., float], *numbers: Across) -> Across:
    """A law that is monotone in each number, of numbers with intervals. Where several have one, its ends are taken
    together, which is wide where they are correlated."""
    at = law(*(value for value, _ in numbers))
    if all(interval is None for _, interval in numbers):
        return at, None
    corners: list[list[float]] = [[]]
    for value, interval in numbers:
        corners = [[*c, end] for c in corners for end in (interval or (value,))]
    ends = [law(*corner) for corner in corners]
    return at, (min(ends), max(ends))
