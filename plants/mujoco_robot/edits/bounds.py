"""What may be added to a model, at least and at most, as its own masses, inertias and motors have it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from plants.mujoco_robot.edits.loads import largest_inertias, largest_torques
from plants.mujoco_robot.edits.reference import reference
from plants.mujoco_robot.structure.compiled_robot import CompiledRobot
from plants.mujoco_robot.structure.servo_damping import servo_damping
from residual_mpc.effects.library import BY_NAME

if TYPE_CHECKING:
    import mujoco

MOST_PLAY = 0.6  # rad
SOFTEST = 20.0  # rad^2/s^2: a spring in units of the inertia that it carries, on which an arm would hang like a rope
MOST_ROTOR = 3.0  # of what a joint carries: more would be felt as nothing but rotor
MOST_ON_SMALLEST = 10.0  # of what the smallest driven joint carries, whose rotor is often the larger part
QUICK = 100.0  # rad/s^2 (m/s^2) that robots' motors commonly give their own rotors at full torque, or more
SLUGGISH = 5.0  # rad/s^2 (m/s^2) below which no motor would be built into an arm
FARTHEST_TOOL = 0.5  # of the reach: a load that is centred farther from its site is no tool
SHORTEST = 0.1  # m of reach, of a body whose site is at its joint
KEPT = 0.1  # of a mass, at least, where mass is taken away
KEPT_ROTOR = 0.05
STRONGEST = 5.0  # times the model's, to which the gain of a servo may scale its damping

Bounds = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class PhysicalBounds:
    """The limits of every parameter on a robot with one setting."""

    robot: CompiledRobot

    def of(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        """The limits of a parameter at one slot, or of one value for all slots (None)."""
        low, high = self._of_slots(effect, parameter)
        if slot is not None and len(low) > 1:
            at = self.robot.slots(effect).index(slot)
            return float(low[at]), float(high[at])
        rotor = BY_NAME[effect].parameter(parameter).quantity == "rotor inertia"
        most = self._rotor_of_all() if rotor and len(low) > 1 else float(high.min())
        return float(low.max()), most

    def _of_slots(self, effect: str, parameter: str) -> Bounds:
        """(slots,) each, or (1,) where one limit holds for all."""
        robot, m, dof = self.robot, self.robot.model, self.robot.dofs
        free = np.full(1, np.inf)
        match BY_NAME[effect].parameter(parameter).quantity:
            case "dry friction":
                return -m.dof_frictionloss[dof], self._torques
            case "viscous damping":
                # a stronger servo damps more, which friction may take away; none of it leaves less than no damping
                return -(m.dof_damping[dof] + STRONGEST * servo_damping(robot)), np.full(len(dof), np.inf)
            case "rotor inertia":
                return (KEPT_ROTOR - 1.0) * m.dof_armature[dof], self._rotors()
            case "tool mass":
                return (KEPT - 1.0) * m.body_mass[[robot.payload[0]]], np.full(1, _moving_mass(m))
            case "tool x" | "tool y" | "tool z":
                far = np.full(1, FARTHEST_TOOL * _reach(m, *robot.payload))
                return -far, far
            case "link mass":
                return (KEPT - 1.0) * m.body_mass[1:], np.full(m.nbody - 1, _moving_mass(m))
            case "gear play":
                return -free, np.full(1, MOST_PLAY)
            case "gear stiffness":
                stiffness = SOFTEST * np.array([reference(robot, "inertia", j) for j in robot.geared])
                return (stiffness, np.full(len(stiffness), np.inf)) if len(stiffness) else (-free, free)
            case "link length" if robot.lengths is not None and robot.lengths.lines:
                lengths = np.array([length for _, length in robot.lengths.lines.values()])
                return (KEPT - 1.0) * lengths, 2.0 * lengths
        return -free, free

    def _rotors(self) -> np.ndarray:
        """(joints,) kg m^2, the largest rotor that may be added at each joint alone.

        A wrist's geared motor may carry less than its own rotor: it may have one that its torque still accelerates, or,
        where that is not known, one as large as a typical joint of the arm.
        """
        carried, torque, driven = self._inertias, self._torques, np.unique(self.robot.driven)
        motor = np.where(np.isfinite(torque), torque / SLUGGISH, MOST_ROTOR * np.median(carried[driven]))
        return np.maximum(np.maximum(MOST_ROTOR * carried, motor), self._rotor_of_all())

    def _rotor_of_all(self) -> float:
        """kg m^2, the largest rotor that may be added at every joint alike.

        It has to be possible at the smallest driven joint: a shoulder's would freeze the wrists. One as large as the
        model's own largest is possible everywhere.
        """
        carried, torque, driven = self._inertias, self._torques, np.unique(self.robot.driven)
        rotor = self.robot.model.dof_armature[self.robot.dofs]
        small = driven[np.argmin(carried[driven])]
        motor = np.where(np.isfinite(torque), torque / QUICK, 0.0)
        typical = np.maximum(MOST_ROTOR * carried, motor)[driven].min()
        return float(max(typical, MOST_ON_SMALLEST * carried[small] + rotor[small], rotor.max()))

    @cached_property
    def _inertias(self) -> np.ndarray:
        return largest_inertias(self.robot)

    @cached_property
    def _torques(self) -> np.ndarray:
        return largest_torques(self.robot)


def bounds_of_all(
    settings: Sequence[PhysicalBounds], effect: str, parameter: str, slot: str | None
) -> tuple[float, float]:
    """The limits on a robot with several settings: nothing may become negative in any, and the widest upper limit
    counts."""
    found = [one.of(effect, parameter, slot) for one in settings]
    return max(low for low, _ in found), max(high for _, high in found)


def _moving_mass(model: "mujoco.MjModel") -> float:
    """kg of all bodies that a joint moves."""
    return float(model.body_mass[model.body_weldid != 0].sum())


def _reach(model: "mujoco.MjModel", body: int, place: np.ndarray) -> float:
    """m along the bodies from the first that a joint carries to a place (3,) on one of them."""
    reach = float(np.linalg.norm(place))
    while model.body_parentid[body] != 0:
        reach += float(np.linalg.norm(model.body_pos[body]))
        body = int(model.body_parentid[body])
    return max(reach, SHORTEST)
