"""What of an arm neither its model nor the library describes: flaws of the model, and causes without a name."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_UNEVEN = 5.0  # 1/rad, how fast uneven friction varies over the angle
_RINGS_OUT = 0.2  # damping ratio of a link that bends
_ENGAGED = 0.03  # rad/s from which on friction acts in full


@dataclass(frozen=True)
class ArmFlaws:
    """Constants of n joints, (n,) where they are arrays; zeros do nothing.

    flex: rad/s, at which every link swings as it bends up and down, 0 where links are stiff. tilt: rad by which every
    axis is turned about its link. rooted: N m at 1 rad/s, friction that grows with the root of the speed. soft: share
    of the torque that a servo loses at large torques, of ``usual`` (N m) and more. uneven: N m, friction that varies
    over the angle. belt: N m s/rad between neighbouring joints. supply: how much the torques drop when all actuators
    are asked for their usual ones.
    """

    flex: float = 0.0
    tilt: float = 0.0
    rooted: Array | float = 0.0
    soft: float = 0.0
    usual: Array | float = 1.0
    uneven: Array | float = 0.0
    belt: Array | float = 0.0
    supply: float = 0.0

    def driven(self, torque: Array) -> Array:
        """What the actuators give (s, n) N m where the model expects ``torque``."""
        if not (self.soft or self.supply):
            return torque
        load = np.abs(torque) / self.usual
        shared = np.mean(load, axis=1, keepdims=True)
        return np.asarray(torque * (1.0 - self.soft * load / (1.0 + load)) / (1.0 + self.supply * shared))

    def pull(self, q: Array, v: Array) -> Array | float:
        """Torques (s, n) N m on joints at ``q`` rad, ``v`` rad/s."""
        total: Array | float = 0.0
        along = np.tanh(v / _ENGAGED)
        if np.any(self.rooted):
            total = total - self.rooted * np.sqrt(np.abs(v)) * along
        if np.any(self.uneven):
            total = total - self.uneven * (1.0 + np.sin(_UNEVEN * q)) * along
        if np.any(self.belt):
            apart = self.belt * np.diff(v, axis=1)
            total = total + np.pad(apart, ((0, 0), (0, 1))) - np.pad(apart, ((0, 0), (1, 0)))
        return total


def built_in(spec: mujoco.MjSpec, flaws: ArmFlaws, inertia: Array) -> None:
    """Put what is a matter of bodies into a chain of link1 to linkn, in place; inertia: (n,) kg m^2 at the joints."""
    for i, at in enumerate(inertia):
        body, joint = spec.body(f"link{i + 1}"), spec.joint(f"j{i + 1}")
        x, y, z = joint.axis
        c, s = np.cos(flaws.tilt), np.sin(flaws.tilt)
        if flaws.tilt:
            joint.axis = [x, c * y - s * z, s * y + c * z]
        if flaws.flex:
            bend = body.add_joint(name=f"bend{i + 1}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
            bend.stiffness[0] = at * flaws.flex**2
            bend.damping[0] = 2.0 * _RINGS_OUT * at * flaws.flex
