"""The SCALER arm's figures: frames, masses, and the limits and servo that the project chose for it.

Frames, masses and inertias are limb 0 of the PyBullet model that the first author of the paper published (github
AlexS28/ClimbSim_code @8315737, MIT, `SCALAR_6DoF_gripper_test.urdf`); products of inertia, below 1e-6 kg m^2, are left
out. Lengths in m, angles in rad, masses in kg, inertias in kg m^2. What is chosen here and not published says so.
"""

from dataclasses import dataclass
from math import pi

Triple = tuple[float, float, float]

MOTORS = ("shoulder", "a", "f", "wrist1", "wrist2", "wrist3")  # the order of theta_1 to theta_6
PASSIVE = ("b", "e")
# rad, chosen: the gripper points down and aside, so that a circle moves every motor
HOME = (0.0, -0.1, 0.3, 0.35, 0.412, 0.0)


@dataclass(frozen=True)
class Frame:
    """A frame in its parent's: xyz m, then fixed-axis roll, pitch and yaw rad (the convention of a URDF)."""

    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Body:
    """Mass kg, its centre m and the moments of inertia about it kg m^2, along the axes of the body's frame."""

    mass: float
    com: Triple
    inertia: Triple


@dataclass(frozen=True)
class Joint:
    """A hinge about its own z, between a parent link and a child link of the same name as the joint."""

    name: str
    parent: str
    frame: Frame
    body: Body


@dataclass(frozen=True)
class Servo:
    """A position-controlled motor, chosen: geared servos of about 4 N m.

    stiffness N m/rad and damping N m s/rad of the loop, torque N m at which it stops, armature kg m^2 (the rotor seen
    through the gear), friction N m s/rad of the bearings.
    """

    stiffness: float
    damping: float
    torque: float
    armature: float
    friction: float


@dataclass(frozen=True)
class Arm:
    """Joints in the order of the tree, the two points that the loop holds together, and what rides on the wrist.

    Raises ValueError where a joint's parent does not come before it.
    """

    joints: tuple[Joint, ...]
    on_b: Triple  # m, in b: the published C0
    on_e: Triple  # m, in e: the published C1, held to C0
    gripper: Frame  # in wrist3
    gripper_body: Body  # both fingers included
    tool: Triple  # m, in the gripper's frame
    limits: tuple[tuple[float, float], ...]  # rad, of each motor
    speed: float  # rad/s, the fastest that a motor is asked to turn
    servo: Servo
    passive_friction: float  # N m s/rad, of the two joints without a motor
    period: float  # s between commands, as in the paper

    def __post_init__(self) -> None:
        seen = {"body"}
        for joint in self.joints:
            if joint.parent not in seen:
                raise ValueError(f"joint {joint.name!r} must come after its parent {joint.parent!r}")
            seen.add(joint.name)
        if len(self.limits) != len(MOTORS) or any(low >= high for low, high in self.limits):
            raise ValueError(f"limits must be one (low, high) for each of {MOTORS}, got {self.limits}")

    def joint(self, name: str) -> Joint:
        """The joint of that name. Raises KeyError."""
        return {j.name: j for j in self.joints}[name]


SCALER = Arm(
    joints=(
        Joint(
            "shoulder",
            "body",
            Frame(),  # chosen: the mount is the origin of the world
            Body(0.20375, (0.00424, 0.0, -0.07962), (5.41e-5, 6.33e-5, 5.79e-5)),
        ),
        Joint(
            "a",
            "shoulder",
            Frame((-0.0105, 0.0, -0.0713), (pi / 2, pi / 2, 0.0)),
            Body(0.01728, (0.04918, 0.0, -0.00051), (7.7e-7, 3.80e-6, 4.04e-6)),
        ),
        Joint(
            "b",
            "a",
            Frame((0.113, 0.0, 0.0), (0.0, 0.0, 1.19652)),
            Body(0.02032, (0.07100, 0.0, 0.0), (5.6e-7, 1.494e-5, 1.494e-5)),
        ),
        Joint(
            "f",
            "shoulder",
            Frame((-0.0105, 0.0, -0.0998), (pi / 2, 0.0, 0.0)),
            Body(0.02281, (0.06327, 0.0, 0.0), (7.7e-7, 7.49e-6, 7.57e-6)),
        ),
        Joint(
            "e",
            "f",
            Frame((0.113, 0.0, 0.0), (0.0, 0.0, -1.17617)),
            Body(0.14559, (0.15427, -0.00062, 0.0), (4.266e-5, 5.065e-5, 4.428e-5)),
        ),
        Joint(
            "wrist1",
            "e",
            Frame((0.21755, -0.000125, 0.0), (-pi / 2, 0.0, 0.0)),
            Body(0.01141, (-0.00439, -0.03134, 0.0002), (4.85e-6, 3.17e-6, 3.06e-6)),
        ),
        Joint(
            "wrist2",
            "wrist1",
            Frame((0.0, 0.0, 0.0), (pi / 2, pi / 2, pi)),
            Body(0.08876, (0.0, -0.03231, -0.03251), (2.319e-5, 1.728e-5, 1.728e-5)),
        ),
        Joint(
            "wrist3",
            "wrist2",
            Frame((0.0, 0.0, 0.0), (pi / 2, pi / 2, 0.0)),
            Body(0.00980, (-0.01268, 0.0, 0.05148), (3.16e-6, 3.49e-6, 1.15e-6)),
        ),
    ),
    on_b=(0.142, 0.0, 0.0),
    on_e=(0.1333, -0.03475, 0.0),
    gripper=Frame((-0.03, 0.0, 0.075), (3.14, 0.0, 1.57)),  # the published digits, not pi and pi / 2
    gripper_body=Body(0.11637, (0.0, 0.033, 0.01), (3.2e-5, 1.4e-5, 3.2e-5)),
    tool=(0.0, 0.0, -0.048),
    limits=((-1.5, 1.5), (-0.8, 0.5), (-0.3, 1.0), (-1.5, 1.5), (-1.4, 1.4), (-2.6, 2.6)),
    speed=4.0,
    servo=Servo(stiffness=60.0, damping=6.0, torque=4.0, armature=0.005, friction=0.02),
    passive_friction=0.001,
    period=0.01,
)
