"""An arm as it really is: its rigid bodies stepped by MuJoCo in fine steps, all else here.

The nominal model takes coarser steps with implicit velocity terms. The truth steps at 0.5 ms, as a leapfrog
(velocities live between the positions), computes every torque itself, and its friction is LuGre's (Canudas
de Wit et al. 1995, equations 1 to 4): bristles with a state of their own, so that a joint at rest creeps
before it breaks away. All runs of a case, or all windows of a log, step side by side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import mujoco
import mujoco.batch
import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm.flaws import ArmFlaws
from plants.blind_families.arm.gear import GearLaw, Rotors
from plants.blind_families.arm.surroundings import Surroundings
from plants.mujoco_log import silence_mujoco
from plants.mujoco_timers import stop_mujoco_timers

Array = NDArray[np.float64]
STEP = 0.0005  # s
_PRESLIDING = 4e-4  # rad, how far bristles bend before they slip
_DENT = 0.06  # rad, how wide a dented tooth is
_CURRENT_SHARE = 0.12  # the electrical time constant as a share of the whole lag


class NominalArm(Protocol):
    """The arm as its model has it, n motors; every array is (n,), by motor."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that the motors drive."""
        ...

    @property
    def kind(self) -> str:
        """position, velocity or torque: what the actuators take."""
        ...

    @property
    def home(self) -> Array:
        """rad, the pose that motions are centred on"""
        ...

    @property
    def length(self) -> Array:
        """m, of the link that the motor carries"""
        ...

    @property
    def mass(self) -> Array:
        """kg, of that link"""
        ...

    @property
    def armature(self) -> Array:
        """kg m^2"""
        ...

    @property
    def kp(self) -> Array:
        """N m/rad"""
        ...

    @property
    def kv(self) -> Array:
        """N m s/rad"""
        ...

    @property
    def stop(self) -> Array:
        """N m at which the actuators stop, as the model knows"""
        ...

    def rigid(self, truth: ArmTruth) -> Rigid:
        """The bodies under the truth's masses and armatures."""
        ...

    def write_model(self, folder: Path) -> list[str]:
        """Write what the robot file refers to; the file's lines that name plant and model."""
        ...


@dataclass(frozen=True)
class Rigid:
    """The rigid bodies of a truth, masses changed, actuators taken out, at the fine step.

    gears: what lies between motors and links that are no rigid whole; None where all are.
    motors (n,): place of each motor's joint in positions and velocities; close puts the joints without a motor where
    closed chains hold them, in place, given positions and velocities (s, all joints) of the motors.
    """

    model: mujoco.MjModel
    motors: NDArray[np.int64]
    close: Callable[[Array, Array], None]
    gears: GearLaw | None = None


@dataclass(frozen=True)
class ArmTruth:
    """Every constant of the truth, each (n,) unless said otherwise; zeros, ones and infinities do nothing."""

    arm: NominalArm
    delay: Array  # s
    dead_zone: Array  # unit of the command, or rad of position error
    lag: Array  # s
    gain: Array
    limit: Array  # N m
    sag: float  # 1/s at the average load
    torque_scale: Array  # N m, usual torque of each actuator: what the battery calls average
    static: Array  # N m
    kinetic: Array  # N m
    stribeck: Array  # rad/s
    viscous: Array  # N m s/rad
    load: Array  # 1
    armature: Array  # kg m^2, added
    payload: float  # kg, at the tool
    link_mass: Array  # kg, added
    link_com: Array  # m, the centre moved along the link
    longer: Array  # m, how much farther along the link the next joint sits
    stiffness: Array  # N m/rad between motor and link
    wound: Array  # rad by which that spring is usually wound
    ringing: Array  # of critical damping, of motor and link against each other on that spring
    play: Array  # rad between motor and link
    # causes that no library names
    dent: Array  # N m, which the motor needs on either side of a dented tooth
    dented: Array  # rad, where that tooth meets
    cable: Array  # N m, drag of a cable that takes hold on one side of the home pose
    warm_up: Array  # N m, friction lost as the joint warms
    gusts: Array  # (m, n + 2): from s, to s, torques N m
    flaws: ArmFlaws = ArmFlaws()  # the rest of them, and what is wrong with the model
    beside: Surroundings = Surroundings()  # servos, springs, stops and the mounting
    ahead: float = 0.0  # m, how much farther than the tool the payload is along the last link


def ideal(arm: NominalArm) -> ArmTruth:
    """The truth without any effect."""
    n = len(arm.joints)
    zero, one = np.zeros(n), np.ones(n)
    return ArmTruth(
        arm,
        zero,
        zero,
        zero,
        one,
        np.full(n, np.inf),
        0.0,
        one,
        zero,
        zero,
        0.1 * one,
        zero,
        zero,
        zero,
        0.0,
        zero,
        zero,
        zero,
        np.full(n, np.inf),
        one,
        0.04 * one,
        zero,
        zero,
        zero,
        zero,
        zero,
        np.zeros((0, n + 2)),
    )


class Stepper:
    """Simulations (s of them) of one truth, side by side. A leaf with explicit memory; used for one pass."""

    def __init__(self, truth: ArmTruth, q: Array, v: Array, command: Array, seconds: Array):
        """Start at ``q``, ``v`` (s, n), ``command`` (s, n) held so far, ``seconds`` (s,) into each run."""
        s, n = q.shape
        rigid = truth.arm.rigid(truth)
        self.motors = rigid.motors
        silence_mujoco()
        stop_mujoco_timers()
        self.batch = mujoco.batch.Batch(rigid.model, s, nthread=1)
        if any(truth.beside.tilt):
            self.batch.expand("opt.gravity")[:] = truth.beside.gravity(rigid.model.opt.gravity)
        self.batch.reset()
        self.all_q, self.all_v, self.force = (self.batch.bind(f) for f in ("qpos", "qvel", "qfrc_applied"))
        self.all_q[:, self.motors], self.all_v[:, self.motors] = q, v
        rigid.close(self.all_q, self.all_v)
        self.before = v.copy()
        self.rotors = None if rigid.gears is None else Rotors(rigid.gears, q, v)
        self.bristle = np.zeros((s, n))
        whole = np.floor(truth.delay / STEP + 1e-9).astype(int)
        self.whole, self.part = whole, truth.delay / STEP - whole
        self.line = np.repeat(command[None], whole.max() + 2, axis=0)  # newest last
        self.slow, self.current, self.ramp = command.copy(), command.copy(), command.copy()
        self.charge = np.zeros(s)
        self.trim = self._settled(truth, command, q) if np.any(truth.beside.integral) else np.zeros((s, n))
        self.seconds = seconds.astype(float).copy()
        self.torque = np.zeros((s, n))
        self.become(truth)

    def become(self, truth: ArmTruth) -> None:
        """Go on as another truth with the same bodies, gears and delays."""
        self.p = truth
        rubs = np.any(truth.static) or np.any(truth.load) or np.any(truth.warm_up)
        self.rubbing = bool(rubs) or truth.beside.loses

    @property
    def q(self) -> Array:
        """Angles of the motors' joints (s, n) rad."""
        return np.asarray(self.all_q[:, self.motors])

    @property
    def v(self) -> Array:
        """Their speeds (s, n) rad/s, half a step earlier."""
        return np.asarray(self.all_v[:, self.motors])

    def step(self, command: Array, on: Array) -> None:
        """Advance by STEP under ``command`` (s, n) as sent now; actuators act where ``on`` (s, n) is 1."""
        p, arm = self.p, self.p.arm
        u = self._arrived(command)
        q, now = self.q, self.v
        # the leapfrog's velocity lives half a step back: carry it to the positions' instant
        v = now + 0.5 * (now - self.before)
        self.before = now
        link = q, v
        if self.rotors is not None:  # from here on q and v are the motors' side
            q, v = self.rotors.seen(q, v)
        torque = self._servo(u, q, v)
        if np.any(p.beside.integral):
            torque = torque + arm.kp * self.trim
            self.trim = p.beside.summed(self.trim, u - q, np.abs(torque) < np.minimum(arm.stop, p.limit), on, STEP)
        torque = p.flaws.driven(torque) * p.gain
        if p.sag:
            torque *= (1.0 - np.minimum(self.charge, 0.9))[:, None]
            self.charge += STEP * p.sag * (0.7 + 0.3 * np.mean(np.abs(torque) / p.torque_scale, axis=1))
        torque = np.clip(torque, -arm.stop, arm.stop)
        if np.isfinite(p.limit).any():
            torque = torque / (1.0 + (np.abs(torque) / p.limit) ** 12) ** (1.0 / 12)
        torque = p.beside.driven(torque, v) * on
        self.torque = torque
        total = torque - p.viscous * v + p.flaws.pull(q, v) + p.beside.pull(q, v)
        if self.rubbing:
            total -= self._friction(v, torque)
        if p.dent.any():
            away = (q - p.dented) / _DENT
            total += p.dent * away * np.exp(0.5 - 0.5 * away**2)
        if p.cable.any():
            pull = np.maximum(q - arm.home, 0.0)
            total -= p.cable * pull * (1.0 + np.tanh(v / 0.2))
        for row in p.gusts:
            shape = np.sin(np.pi * np.clip((self.seconds - row[0]) / (row[1] - row[0]), 0.0, 1.0))
            total += shape[:, None] * row[2:]
        self.force[:, self.motors] = total if self.rotors is None else self.rotors.step(total, *link, STEP)
        self.batch.step()
        self.seconds += STEP

    def _settled(self, truth: ArmTruth, command: Array, q: Array) -> Array:
        """(s, n) rad that the servos' integral parts add where they have long held the arm at ``q``."""
        bias = self.batch.bind("qfrc_bias")
        self.batch.forward()
        needed = np.asarray(bias[:, self.motors]) - truth.beside.pull(q, np.zeros_like(q))
        return np.where(np.greater(truth.beside.integral, 0.0), needed / truth.arm.kp - (command - q), 0.0)

    def _arrived(self, command: Array) -> Array:
        p = self.p
        u = command
        if p.delay.any():
            self.line = np.roll(self.line, -1, axis=0)
            self.line[-1] = command
            last, joint = len(self.line) - 1, np.arange(len(p.delay))
            newer = self.line[last - self.whole, :, joint].T
            older = self.line[last - self.whole - 1, :, joint].T
            u = (1.0 - self.part) * newer + self.part * older
        if p.dead_zone.any() and p.arm.kind != "position":
            u = np.where(np.abs(u) < p.dead_zone, 0.0, u)
        self.ramp = u = p.beside.ramped(self.ramp, u, STEP)
        if p.lag.any():
            fast = np.maximum(_CURRENT_SHARE * p.lag, 1e-6)
            self.current += (u - self.current) * (1.0 - np.exp(-STEP / fast))
            rest = np.maximum((1 - _CURRENT_SHARE) * p.lag, 1e-6)
            self.slow += (self.current - self.slow) * (1.0 - np.exp(-STEP / rest))
            u = np.where(p.lag > 0, self.slow, u)
        return u

    def _servo(self, u: Array, q: Array, v: Array) -> Array:
        arm = self.p.arm
        if arm.kind == "torque":
            return u.copy()
        if arm.kind == "velocity":
            return arm.kv * (u - v)
        error = u - q
        if self.p.dead_zone.any():
            error = np.where(np.abs(error) < self.p.dead_zone, 0.0, error)
        return arm.kp * self.p.beside.answered(error) - arm.kv * v

    def _friction(self, v: Array, torque: Array) -> Array:
        p = self.p
        warm = p.warm_up * np.exp(-self.seconds / 6.0)[:, None] if p.warm_up.any() else 0.0
        rub = p.load * np.abs(torque) + warm + p.beside.lost(torque, v)
        level = p.kinetic + (p.static - p.kinetic) * np.exp(-((v / p.stribeck) ** 2)) + rub
        # the bristles' stiffness follows the level, so that each slips after the same bend
        level = np.maximum(level, 1e-9)
        z = self.bristle
        rate = np.abs(v) / _PRESLIDING
        after = (z + STEP * v) / (1.0 + STEP * rate)  # implicit: bristles are stiff
        self.bristle = after
        return level / _PRESLIDING * after + np.sqrt(level / _PRESLIDING * p.arm.armature) * (after - z) / STEP


def inside(truth: ArmTruth) -> bool:
    """Whether the constants are ones that a robot can have."""
    return bool(np.all(truth.arm.mass + truth.link_mass > 0) and np.all(truth.gain > 0) and np.all(truth.limit > 0))
