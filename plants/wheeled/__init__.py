"""A two-wheeled robot in MuJoCo and in PyBullet, its twin, and the motions that it is asked to follow."""

from plants.wheeled.drive import WheeledDrive
from plants.wheeled.engines.geometry import Geometry, Slips, Wheel
from plants.wheeled.simulators import bullet_drive, mujoco_drive

__all__ = ["Geometry", "Slips", "Wheel", "WheeledDrive", "bullet_drive", "mujoco_drive"]
