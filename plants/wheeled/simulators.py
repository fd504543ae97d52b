"""The two simulators by name; the paper's Webots is no package that could be installed."""

from plants.wheeled.drive import WheeledDrive
from plants.wheeled.engines.geometry import Geometry, Slips
from plants.wheeled.engines.mujoco_engine import MujocoEngine
from plants.wheeled.engines.pybullet_engine import BulletEngine

TURTLEBOT = Geometry()
EVEN = Slips()  # a floor without slippery patches


def mujoco_drive(geometry: Geometry = TURTLEBOT, slips: Slips = EVEN, step: float = 0.001) -> WheeledDrive:
    """The robot in MuJoCo; step: s, the engine's longest."""
    return WheeledDrive("two_wheels_mujoco", MujocoEngine, geometry, slips, step)


def bullet_drive(geometry: Geometry = TURTLEBOT, slips: Slips = EVEN, step: float = 0.001) -> WheeledDrive:
    """The robot in PyBullet; step: s, the engine's longest. BadInput at the start of a plant where it is missing."""
    return WheeledDrive("two_wheels_pybullet", BulletEngine, geometry, slips, step)
