"""The arm as a robot of the diagnosis: its MJCF in the batched replay, the loop closed analytically."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_log import silence_mujoco
from plants.scaler_arm.engines.mjcf import mjcf
from plants.scaler_arm.kinematics.geometry import MOTORS, PASSIVE, SCALER, Arm
from plants.scaler_arm.kinematics.loop_closure import closed
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

if TYPE_CHECKING:
    from plants.mujoco_robot import MujocoRobot

SERVO = ("stiffness", "damping", "torque", "armature", "friction")  # what [parameters] may name


def build(robot: RobotFile) -> "MujocoRobot":
    """The robot of a file whose plant is `scaler_arm`, or of that name alone.

    Raises BadInput for a parameter that is unknown or not positive.
    """
    import mujoco

    from plants.mujoco_robot.loading.compile import prepared
    from plants.scaler_arm.dynamics.stepping_arm import SteppingArm

    silence_mujoco()
    arm = with_servo(SCALER, robot)
    model = prepared(mujoco.MjModel.from_xml_string(mjcf(arm)))
    places, dofs = (
        tuple(int(x) for n in MOTORS + PASSIVE for x in getattr(model.joint(n), kind)) for kind in ("qposadr", "dofadr")
    )
    return SteppingArm(
        robot.name,
        model,
        (int(model.body("gripper").id), np.array(arm.tool)),
        robot.servo_feedback,
        robot.position_sensor,
        loops=FiveBarLoop(arm, places, dofs),
        arm=arm,
    )


@dataclass(frozen=True)
class FiveBarLoop:
    """See `plants.mujoco_robot.structure.loops.Loops`: in closed form, a whole batch at once.

    places, dofs (8,): of MOTORS + PASSIVE in positions and velocities.
    """

    arm: Arm
    places: tuple[int, ...]
    dofs: tuple[int, ...]
    passive: tuple[str, ...] = PASSIVE

    def close(self, q: np.ndarray, v: np.ndarray) -> None:
        n = len(MOTORS)
        joints = closed(q[:, self.places[:n]], v[:, self.dofs[:n]], self.arm)
        q[:, self.places[n:]] = joints.passive
        v[:, self.dofs[n:]] = joints.rates


def with_servo(arm: Arm, robot: RobotFile) -> Arm:
    """The arm with the servo figures of the file's [parameters]."""
    for name, value in robot.parameters.items():
        if name not in SERVO:
            remedy = f"the parameters of scaler_arm are {', '.join(SERVO)}, the same for every servo"
            raise BadInput(f"unknown parameter {name!r}", robot.source or robot.name, remedy)
        if not (np.isfinite(value) and value > 0):
            fault = f"parameter {name} must be a positive number in SI units, got {value}"
            raise BadInput(fault, robot.source or robot.name)
    return replace(arm, servo=replace(arm.servo, **robot.parameters))
