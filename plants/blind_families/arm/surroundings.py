"""What servos, springs, stops and mountings really do to an arm's joints, by laws of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_STIFFENS = 0.4  # 1/rad: a cable pulls by sinh of this times its way, over this
_GREAT = 0.5  # rad, from which on an integral part counts an error for less and less
_FORGETS = 0.05  # s, in which it does once its actuator is off
_SETTLES = 0.02  # s, in which a ramp comes to rest at its end
_SHARP = 12  # order of the norm that joins a motor's torque to its limit
_TURNS = 0.05  # of a joint's usual power: where driving and being driven meet
_DAMPED = 0.8  # s/m, of a stop: Hunt and Crossley 1975, equation 7, with an exponent of 1.5
_FLAT = 1.5  # by which a ripple's waves are flattened: tanh of so many times a sine
_COUNT = 2.0 * np.pi / 4096.0  # rad, in which a servo's firmware counts its position error
_DEEP = 0.01  # rad, to which a stop gives at the torque that is stated for it


@dataclass(frozen=True)
class Surroundings:
    """Constants of n joints, each (n,) where it is an array; the values here do nothing.

    ramp: command unit/s. integral: 1/s. stall: N m, no_load: rad/s. forward, backward: 1, and power: W, usual at each
    joint. spring: N m/rad, rest: rad. offset: N m. ripple: N m, of the first harmonic, cycles: 1/turn, phase: rad.
    stop: rad, side: 1 where it holds from above and -1 from below, hard: N m, the stop's push at a depth of _DEEP.
    tilt: rad about x, then about the ground's y axis. stiffer: 1, of a servo's position gain.
    """

    ramp: Array | float = np.inf
    integral: Array | float = 0.0
    stall: Array | float = np.inf
    no_load: Array | float = 1.0
    forward: Array | float = 1.0
    backward: Array | float = 1.0
    power: Array | float = 1.0
    spring: Array | float = 0.0
    rest: Array | float = 0.0
    offset: Array | float = 0.0
    ripple: Array | float = 0.0
    cycles: Array | float = 1.0
    phase: Array | float = 0.0
    stop: Array | float = np.inf
    side: float = 1.0
    hard: Array | float = 1.0
    tilt: tuple[float, float] = (0.0, 0.0)
    stiffer: Array | float = 1.0

    @property
    def loses(self) -> bool:
        """Whether a gear has a loss."""
        return bool(np.any(np.not_equal(self.forward, 1.0)) or np.any(np.not_equal(self.backward, 1.0)))

    def ramped(self, before: Array, u: Array, dt: float) -> Array:
        """The setpoint (s, n) after dt, which follows u with a rate that fades as it arrives."""
        if not np.isfinite(self.ramp).any():
            return u
        away = u - before
        reach = np.minimum(self.ramp, 1e9)
        follows = before + dt * reach * np.tanh(away / (reach * _SETTLES))
        return np.asarray(np.where(np.isfinite(self.ramp), follows, u))

    def answered(self, error: Array) -> Array:
        """The position error (s, n) rad that the modelled gain would have to answer to give what the servo does, whose
        firmware counts the error in whole steps."""
        if not np.any(np.not_equal(self.stiffer, 1.0)):
            return error
        counted = _COUNT * np.round(error / _COUNT)
        return np.asarray(np.where(np.equal(self.stiffer, 1.0), error, self.stiffer * counted))

    def summed(self, before: Array, error: Array, free: NDArray[np.bool_], on: Array, dt: float) -> Array:
        """Setpoints (s, n) rad that the integral parts add after dt: they sum up where the force is free of its limit
        (s, n), and forget where the actuator is off."""
        counted = error / np.sqrt(1.0 + (error / _GREAT) ** 2)
        return np.asarray((before + dt * self.integral * counted * free * on) * (1.0 - (1.0 - on) * dt / _FORGETS))

    def driven(self, torque: Array, v: Array) -> Array:
        """What the motors give (s, n) N m at the speeds v, where the servo asks for `torque`."""
        if not np.isfinite(self.stall).any():
            return torque
        share = np.clip(1.0 - np.sign(torque) * v / self.no_load, 1e-3, 1.0)
        most = np.minimum(self.stall, 1e9) * share
        return np.asarray(torque / (1.0 + (np.abs(torque) / most) ** _SHARP) ** (1.0 / _SHARP))

    def lost(self, torque: Array, v: Array) -> Array | float:
        """N m (s, n) that the gears lose, against the motion."""
        if not self.loses:
            return 0.0
        drives = 0.5 + 0.5 * np.tanh(torque * v / (_TURNS * self.power))
        share = drives * (1.0 - self.forward) + (1.0 - drives) * (1.0 / np.asarray(self.backward) - 1.0)
        return np.asarray(share * np.abs(torque))

    def pull(self, q: Array, v: Array) -> Array | float:
        """Torques (s, n) N m on joints at q rad, v rad/s."""
        total: Array | float = self.offset
        if np.any(self.spring):
            total = total - self.spring * np.sinh(_STIFFENS * (q - self.rest)) / _STIFFENS
        if np.any(self.ripple):
            total = total + self.ripple * _flattened(self.cycles * q + self.phase)
        if np.isfinite(self.stop).any():
            depth = np.maximum(self.side * (q - np.where(np.isfinite(self.stop), self.stop, self.side * 1e9)), 0.0)
            push = self.hard * (depth / _DEEP) ** 1.5 * (1.0 + _DAMPED * self.side * v)
            total = total - self.side * np.maximum(push, 0.0)
        return total

    def gravity(self, still: Array) -> Array:
        """(3,) gravity in the frame of the tilted base, m/s^2."""
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_euler("xy", self.tilt).inv().apply(still))


def _flattened(angle: Array) -> Array:
    """A flattened sine of the angle, rad, whose first harmonic is 1."""
    turn = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    first = 2.0 * np.mean(np.tanh(_FLAT * np.sin(turn)) * np.sin(turn))
    return np.asarray(np.tanh(_FLAT * np.sin(angle)) / first)
