"""Any robot that MuJoCo compiles (MJCF or URDF), replayed as a batch on all cores."""

from plants.mujoco_robot.build import build
from plants.mujoco_robot.robot import MujocoRobot

__all__ = ["MujocoRobot", "build"]
