"""A user's own robot in closed loop: nominal against augmented on a plant of the user's choice."""

from scenarios.own.reference import Waypoints, named_motion, read_reference
from scenarios.own.scenario import OwnScenario, drive

__all__ = ["OwnScenario", "Waypoints", "drive", "named_motion", "read_reference"]
