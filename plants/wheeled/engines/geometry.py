"""A two-wheeled robot as both engines build it: sizes, masses, motors, tyres; and what a twin changes about them."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.errors import BadInput

WHEELS = ("left", "right")


@dataclass(frozen=True)
class Wheel:
    """One wheel with its motor. The defaults are a TurtleBot3 Burger's size, without dry friction and without lag.

    The motor gives gain * (command - speed), at most `torque`, N m. Its dry friction is Stribeck's:
    kinetic + (static - kinetic) exp(-(speed / stribeck)^2) against the motion.
    """

    radius: float = 0.033  # m
    mass: float = 0.0285  # kg
    grip: float = 0.8  # Coulomb's coefficient between tyre and ground
    gain: float = 0.1  # N m s/rad
    torque: float = 0.5  # N m
    armature: float = 1e-3  # kg m^2, the rotor's inertia seen through the gear
    lag: float = 0.0  # s, of the set point on its way to the motor
    static: float = 0.0  # N m
    kinetic: float = 0.0  # N m
    stribeck: float = 0.3  # rad/s

    def __post_init__(self) -> None:
        positive = (self.radius, self.mass, self.gain, self.torque, self.armature, self.stribeck)
        others = (self.grip, self.lag, self.static, self.kinetic)
        if not (all(np.isfinite(v) and v > 0 for v in positive) and all(np.isfinite(v) and v >= 0 for v in others)):
            raise BadInput(f"sizes must be > 0, frictions and lag >= 0, got {self}", "wheel")

    @property
    def plain(self) -> bool:
        """Whether the engine alone is enough: nothing changes between two of its steps."""
        return self.lag == 0.0 and self.static == 0.0 and self.kinetic == 0.0


@dataclass(frozen=True)
class Geometry:
    """The whole robot. Its frame is at the middle of the axle, x forward, y to the left, z up."""

    left: Wheel = Wheel()
    right: Wheel = Wheel()
    track: float = 0.16  # m, wheel centre to wheel centre
    mass: float = 0.94  # kg, chassis without wheels
    centre: tuple[float, float, float] = (-0.032, 0.0, 0.03)  # m, the chassis' centre of mass
    box: tuple[float, float, float] = (0.14, 0.14, 0.14)  # m, the chassis' size, for its inertia
    castor: tuple[float, float] = (-0.081, 0.015)  # m, where behind the axle (x), and its radius

    def __post_init__(self) -> None:
        if not (self.track > 0 and self.mass > 0 and min(self.box) > 0 and self.castor[1] > 0):
            raise BadInput(f"lengths and masses must be > 0, got {self}", "geometry")
        if not self.castor[0] < self.centre[0] < 0.0:
            raise BadInput(
                f"the centre of mass must lie between the axle and the castor, got x = {self.centre[0]} m",
                "geometry",
            )

    @property
    def wheels(self) -> tuple[Wheel, Wheel]:
        return self.left, self.right

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Principal moments (x, y, z) of the chassis, a solid box, kg m^2."""
        x, y, z = self.box
        return tuple(self.mass / 12.0 * s for s in (y * y + z * z, x * x + z * z, x * x + y * y))  # type: ignore[return-value]


def wheel_inertia(wheel: Wheel) -> tuple[float, float]:
    """(about the axle, across it) of a solid disc as wide as half its radius, kg m^2."""
    r = wheel.radius
    return 0.5 * wheel.mass * r * r, wheel.mass * (r * r / 4 + (0.5 * r) ** 2 / 12)


@dataclass(frozen=True)
class Slips:
    """Slippery patches on the floor: each wheel meets `rate` of them a second, each `seconds` long."""

    rate: float = 0.0  # 1/s, while the robot moves or not
    seconds: float = 0.3
    grip: float = 0.02

    def draw(self, rng: np.random.Generator, until: float) -> np.ndarray:
        """(n, 3) of (wheel 0 or 1, from s, to s) up to `until` s."""
        rows = []
        for side in range(2):
            n = rng.poisson(self.rate * until)
            begin = np.sort(rng.uniform(0.0, until, n))
            length = self.seconds * rng.uniform(0.5, 1.5, n)
            rows.append(np.stack([np.full(n, float(side)), begin, begin + length], axis=1))
        return np.concatenate(rows)
