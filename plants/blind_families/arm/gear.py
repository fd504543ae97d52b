"""What lies between a true arm's motors and links: a spring that hardens, or play between stops that bounce a little.

Computed outside MuJoCo, as a leapfrog beside that of the bodies. The rotors are inertias of their own, which the bodies
then lack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_HARDENS = 0.05  # share by which a spring at its usual deflection is harder than at none
_RINGS = 300.0  # rad/s, of motor and link against a stop
_BOUNCE = 0.4  # damping ratio against a stop


@dataclass(frozen=True)
class GearLaw:
    """The gears of g joints, (g,) each.

    stiffness: N m/rad at rest, infinite behind play alone. usual: rad, what the spring is usually wound by. ringing:
    damping ratio of motor and link on that spring. play: rad. rotor, link: kg m^2. damping: N m s/rad, of the rotor.
    """

    joints: NDArray[np.int64]
    stiffness: Array
    usual: Array
    ringing: Array
    play: Array
    rotor: Array
    link: Array
    damping: Array

    def torque(self, wound: Array, rate: Array) -> Array:
        """N m (s, g) from motor to link; ``wound`` rad and ``rate`` rad/s (s, g) are motor less link."""
        reduced = self.rotor * self.link / (self.rotor + self.link)
        soft = np.isfinite(self.stiffness)
        k = np.where(soft, self.stiffness, 0.0)
        deep = wound - np.clip(wound, -0.5 * self.play, 0.5 * self.play)
        spring = k * deep * (1.0 + _HARDENS * (deep / self.usual) ** 2)
        spring += 2.0 * self.ringing * np.sqrt(k * reduced) * np.where((self.play > 0.0) & (deep == 0.0), 0.0, rate)
        stop = reduced * (_RINGS**2 * deep + 2.0 * _BOUNCE * _RINGS * rate)
        stop = np.where(stop * deep > 0.0, stop, 0.0)  # a stop pushes and never pulls
        return np.where(soft, spring, stop)


class Rotors:
    """The motors' sides of some gears. A leaf with explicit memory; used for one pass."""

    def __init__(self, law: GearLaw, q: Array, v: Array):
        """Start unwound at the links' ``q``, ``v`` (s, n)."""
        self.law = law
        self.angle, self.speed = q[:, law.joints].copy(), v[:, law.joints].copy()
        self.before = self.speed.copy()

    def seen(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Angles and speeds (s, n) of the motors, where ``q`` and ``v`` are the links'."""
        angle, speed = q.copy(), v.copy()
        angle[:, self.law.joints] = self.angle
        speed[:, self.law.joints] = self._now()
        return angle, speed

    def step(self, torque: Array, q: Array, v: Array, seconds: float) -> Array:
        """What arrives at the links (s, n) of the torque at the motors (s, n); the rotors go on by ``seconds``."""
        law, now = self.law, self._now()
        through = law.torque(self.angle - q[:, law.joints], now - v[:, law.joints])
        self.before = self.speed
        pull = torque[:, law.joints] - law.damping * now - through
        self.speed = self.speed + seconds * pull / law.rotor
        self.angle = self.angle + seconds * self.speed
        arrived = torque.copy()
        arrived[:, law.joints] = through
        return arrived

    def _now(self) -> Array:
        """Speeds at the angles' instant: the leapfrog keeps them half a step earlier."""
        return self.speed + 0.5 * (self.speed - self.before)
