"""The two simulators as nominal models, by name: `--robot diff_drive_mujoco`, or `plant = "diff_drive_pybullet"`."""

import tempfile
from dataclasses import replace
from pathlib import Path

from plants.mujoco_robot import MujocoRobot
from plants.mujoco_robot import build as build_mujoco
from plants.pybullet_import import import_pybullet
from plants.wheeled.engines.geometry import Geometry
from plants.wheeled.engines.mjcf import mjcf
from plants.wheeled.pybullet_robot import BulletRobot
from plants.wheeled.simulators import TURTLEBOT
from residual_mpc.errors import BadInput
from residual_mpc.models.robot_file import RobotFile

STEP = 0.004  # s: half the time of 2 ms, and a path within 0.2 % of it


def mujoco_model(robot: RobotFile) -> MujocoRobot:
    """The robot of a file whose plant is `diff_drive_mujoco`; [parameters] as for `diff_drive`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "two_wheels.xml"
        path.write_text(mjcf(geometry_of(robot), STEP))
        return build_mujoco(replace(robot, model=path, pose_body="chassis"))


def bullet_model(robot: RobotFile) -> BulletRobot:
    """The robot of a file whose plant is `diff_drive_pybullet`; [parameters] as for `diff_drive`."""
    import_pybullet()  # missing: said at once
    return BulletRobot(robot.name, geometry_of(robot), STEP)


def geometry_of(robot: RobotFile) -> Geometry:
    """Raises BadInput for parameters that are unknown or not positive."""
    known = {"wheel_radius": TURTLEBOT.left.radius, "track_width": TURTLEBOT.track}
    unknown = sorted(set(robot.parameters) - set(known))
    if unknown:
        remedy = f"the parameters are {', '.join(known)} (m)"
        raise BadInput(f"unknown parameter {unknown[0]!r}", robot.source or robot.name, remedy)
    figures = {**known, **robot.parameters}
    wheels = [replace(w, radius=figures["wheel_radius"]) for w in TURTLEBOT.wheels]
    return replace(TURTLEBOT, left=wheels[0], right=wheels[1], track=figures["track_width"])
