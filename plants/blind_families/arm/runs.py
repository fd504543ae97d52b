"""Runs of an arm: every run of a case at once, and the ideal arm replayed over one-second windows of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from plants.blind_families.arm.effects import ArmRobot, ArmSensor
from plants.blind_families.arm.truth import STEP, ArmTruth, NominalArm, Stepper, ideal

Array = NDArray[np.float64]
_UNEVEN = 0.1  # by which a scale differs from its mean on either side
_POLES = (0.75, 0.25)  # of the lag of a sensor's filter
# (sample, positions (r, n), speeds (r, n), memory (r, n), s since the last sample) -> commands (r, n), memory
Controller = Callable[[int, Array, Array, Array, float], tuple[Array, Array]]


@dataclass(frozen=True)
class ReferenceMotion:
    """What the runs of a case are told; r runs of n joints share their stamps."""

    t: Array  # (k,) s, on the grid of STEP
    reference: Array  # (r, k, n) rad
    on: Array  # (r, k, n) 1 where the actuators are on
    correction: float  # 1/s, slow outer loop that pulls the joints onto the reference; 0 in position mode means none


@dataclass(frozen=True)
class Happened:
    """What happened: positions and torques (r, m, n) on the fine grid, rad and N m; commands (r, k, n)."""

    q: Array
    torque: Array
    command: Array

    def seen(self, t: Array, sensor: ArmSensor) -> Array:
        """What noise-free encoders report at ``t`` (k,): (r, k, n) rad."""
        out = np.empty((self.q.shape[0], len(t), self.q.shape[2]))
        fine, q = np.arange(self.q.shape[1]) * STEP, read(self.q, sensor)
        true = t / (1.0 + sensor.skew)  # of two clocks that began together
        for r in range(out.shape[0]):
            for j in range(out.shape[2]):
                out[r, :, j] = np.interp(true - sensor.delay[j], fine, q[r, :, j]) + sensor.bias[j]
        return out

    def speed(self, t: Array, sensor: ArmSensor) -> Array:
        """Joint speeds (r, k, n) rad/s seen at ``t``, half a fine step early: where the leapfrog keeps them.

        A late sensor is late with all that it reports.
        """
        late = np.maximum(t[:, None] / (1.0 + sensor.skew) - sensor.delay[None, :], 0.0)  # (k, n)
        index = np.clip(np.round(late / STEP).astype(int), 1, self.q.shape[1] - 1)
        joint, q = np.arange(self.q.shape[2])[None, :], read(self.q, sensor)
        return (q[:, index, joint] - q[:, index - 1, joint]) / STEP


def read(q: Array, sensor: ArmSensor) -> Array:
    """Positions (r, m, n) rad on the fine grid as the encoders read them: off their axes, scaled, by a little more on
    one side than on the other, as a worn potentiometer does, and behind two low-passes whose time constants add up to
    the lag."""
    n = q.shape[2]
    out, scale, lag = q, np.broadcast_to(sensor.scale, n), np.broadcast_to(sensor.lag, n)
    if np.any(sensor.off_axis):  # the angle at which a read head sees a disc that turns about a point beside its centre
        away = q + sensor.towards
        out = q = q + np.arctan2(sensor.off_axis * np.sin(away), 1.0 - sensor.off_axis * np.cos(away))
    if sensor.crossed:
        out = q = q + sensor.crossed * np.concatenate([np.zeros_like(q[:, :, :1]), q[:, :, :-1]], axis=2)
    if (scale != 1.0).any():
        out = q + (scale - 1.0) * q * (1.0 + _UNEVEN * np.tanh(q / 0.3))
    for j in np.flatnonzero(lag > 0.0):
        out = out.copy() if out is q else out
        for share in _POLES:
            keep = float(np.exp(-STEP / (share * lag[j])))
            line, _ = lfilter([1.0 - keep], [1.0, -keep], out[:, :, j], axis=1, zi=keep * out[:, :1, j])
            out[:, :, j] = line
    return out


def play_robot(robot: ArmRobot, motion: ReferenceMotion) -> Happened | None:
    """Drive all runs, though the arm may not be the same in all of them; None where it runs away."""
    if not robot.changes:
        return play(robot.truth, motion)
    alone = []
    for r in range(len(motion.on)):
        one = replace(motion, reference=motion.reference[r : r + 1], on=motion.on[r : r + 1])
        happened = play(robot.at(r)[0], one, robot.at(r)[1])
        if happened is None:
            return None
        alone.append(happened)
    q, torque, command = (np.concatenate([getattr(h, name) for h in alone]) for name in ("q", "torque", "command"))
    return Happened(q, torque, command)


def play(truth: ArmTruth, motion: ReferenceMotion, change: tuple[float, ArmTruth] | None = None) -> Happened | None:
    """Drive all runs; None where the arm runs away. change: the truth that takes over, and from when on (s)."""
    arm, start = truth.arm, motion.reference[:, 0].copy()
    hold = _hold_torque(arm, start)

    def controller(k: int, q: Array, rate: Array, trim: Array, dt: float) -> tuple[Array, Array]:
        return _controller(arm, motion, k, q, rate, trim, hold, dt)

    return _driven(truth, motion.t, start, motion.on, controller, change)


def replay(truth: ArmTruth, t: Array, start: Array, commands: Array, on: Array) -> Happened | None:
    """What happens from rest at ``start`` (r, n) rad under commands (r, k, n) that nobody corrects; as ``play``."""
    return _driven(truth, t, start, on, lambda k, q, rate, trim, dt: (commands[:, k], trim))


def _driven(
    truth: ArmTruth,
    t: Array,
    start: Array,
    on: Array,
    controller: Controller,
    change: tuple[float, ArmTruth] | None = None,
) -> Happened | None:
    """All runs from rest at ``start`` (r, n), motors on where ``on`` (r, k, n) is 1; None where the arm runs away."""
    runs, _, n = on.shape
    index = np.round(t / STEP).astype(int)
    count = int(index[-1]) + 1
    q, torque = np.empty((runs, count, n)), np.empty((runs, count, n))
    commands = np.empty_like(on)
    trim, last_q = np.zeros((runs, n)), start
    stepper: Stepper | None = None
    command, k = np.zeros((runs, n)), -1
    for i in range(count):
        if k + 1 < len(index) and i == index[k + 1]:
            k += 1
            here = start if stepper is None else stepper.q.copy()
            dt = t[k] - t[max(k - 1, 0)]
            rate = (here - last_q) / dt if dt > 0 else np.zeros_like(here)
            command, trim = controller(k, here, rate, trim, dt)
            commands[:, k], last_q = command, here
            if stepper is None:
                stepper = Stepper(truth, start, np.zeros_like(start), command, np.zeros(runs))
        assert stepper is not None
        if change is not None and i == round(change[0] / STEP):
            stepper.become(change[1])
        q[:, i], torque[:, i] = stepper.q, stepper.torque
        stepper.step(command, on[:, k])
        if i % 2000 == 0 and not np.all(np.abs(stepper.q) < 15.0):
            return None
    if not np.all(np.abs(q) < 15.0):
        return None
    return Happened(q, torque, commands)


def _controller(
    arm: NominalArm, motion: ReferenceMotion, k: int, q: Array, rate: Array, trim: Array, hold: Array, dt: float
) -> tuple[Array, Array]:
    """Commands (r, n) at sample ``k`` and the outer loop's memory."""
    reference, on = motion.reference[:, k], motion.on[:, k]
    if arm.kind == "position":
        if not motion.correction:
            return reference.copy(), trim
        trim = np.clip(trim + dt * motion.correction * (reference - q) * on, -0.3, 0.3)
        return reference + trim, trim
    following = motion.reference[:, min(k + 1, motion.reference.shape[1] - 1)]
    ahead = np.clip((following - reference) / max(dt, 1e-3), -2.0, 2.0)
    if arm.kind == "velocity":
        return ahead + 3.0 * (reference - q), trim
    # a gentle joint controller around the torque that holds the start posture; damping is kept under what the
    # held samples allow
    inertia = arm.kp / 200.0
    trim = np.clip(trim + dt * 40.0 * inertia * (reference - q) * on, -3.0 * np.abs(hold) - 1, 3.0 * np.abs(hold) + 1)
    return hold + trim + inertia * (64.0 * (reference - q) + 14.0 * (ahead - rate)), trim


def _hold_torque(arm: NominalArm, q: Array) -> Array:
    """Nominal gravity torque (r, n) at ``q`` of an open chain; 0 where the actuators take no torques."""
    import mujoco

    out = np.zeros_like(q)
    if arm.kind != "torque":
        return out
    rigid = arm.rigid(ideal(arm))
    data = mujoco.MjData(rigid.model)
    for r, row in enumerate(q):
        data.qpos[rigid.motors], data.qvel[:] = row, 0.0
        mujoco.mj_forward(rigid.model, data)
        out[r] = data.qfrc_bias[rigid.motors]
    return out


def gap_ratio(
    arm: NominalArm,
    motion: ReferenceMotion,
    seen: Array,
    speed: Array,
    commands: Array,
    sigma: Array,
    speed_sigma: Array,
) -> float:
    """Noise-free one-second gap of the ideal arm over its noise floor.

    ``seen`` and ``speed`` (r, k, n) are noise-free measurements; ``sigma`` (n,) rad the noise of a sample
    and ``speed_sigma`` (n,) rad/s that of a window's start velocity. The floor comes from a second set of
    windows that start off by such errors. Written apart from the program's own gap.
    """
    t, n = motion.t, seen.shape[2]
    index = np.round(t / STEP).astype(int)
    begins = np.searchsorted(t, np.arange(0.0, t[-1] - 1.0 + 1e-9, 1.0) - 1e-9)
    r = np.repeat(np.arange(seen.shape[0]), len(begins))
    b = np.tile(begins, seen.shape[0])
    rng = np.random.default_rng(0)  # the same starts for every strength, so that a search sees no noise
    off = rng.standard_normal((2, len(b), n))
    q, v = seen[r, b], speed[r, b]
    starts = np.concatenate([q, q + 0.7 * sigma * off[0]]), np.concatenate([v, v + speed_sigma * off[1]])
    stepper = Stepper(ideal(arm), *starts, np.tile(commands[r, b], (2, 1)), np.tile(t[b], 2))
    error, moved, floor, count = np.zeros(n), np.zeros(n), np.zeros(n), 0
    lookup = np.full(index[-1] + 2, -1)
    lookup[index] = np.arange(len(index))
    held = np.maximum.accumulate(lookup)
    for i in range(round(1.0 / STEP) + 1):
        fine = np.minimum(index[b] + i, len(lookup) - 1)
        k = lookup[fine]
        hit = np.flatnonzero(k >= 0)
        if len(hit):
            measured = seen[r[hit], k[hit]]
            error += ((measured - stepper.q[hit]) ** 2).sum(axis=0)
            moved += ((measured - q[hit]) ** 2).sum(axis=0)
            floor += ((stepper.q[hit + len(b)] - stepper.q[hit]) ** 2 + sigma**2).sum(axis=0)
            count += len(hit)
        now = held[fine]
        stepper.step(np.tile(commands[r, now], (2, 1)), np.tile(motion.on[r, now], (2, 1)))
    used = moved / count > 9 * sigma**2
    if not used.any():
        return 0.0
    return float(np.sqrt(np.sum((error / moved)[used]) / np.sum((floor / moved)[used])))


def replayed_gap(
    motion: ReferenceMotion, seen: Array, again: Array, sigma: Array, horizon: float = 1.0
) -> tuple[float, float]:
    """(gap over noise floor, gap) of a model that foretells whole runs; seen, again: (r, k, n) noise-free and foretold.

    Each window starts at what was seen, as a motion: what an arm behind servos does hardly depends on where it was.
    """
    error, moved, count = np.zeros(seen.shape[2]), np.zeros(seen.shape[2]), 0
    for begin in np.arange(0.0, motion.t[-1] - horizon + 1e-9, horizon):
        inside = np.flatnonzero((motion.t >= begin - 1e-9) & (motion.t <= begin + horizon + 1e-9))
        gone, foretold = (x[:, inside] - x[:, inside[:1]] for x in (seen, again))
        error += ((gone - foretold) ** 2).sum(axis=(0, 1))
        moved += (gone**2).sum(axis=(0, 1))
        count += gone.shape[0] * gone.shape[1]
    used = moved / count > 9 * sigma**2
    if not used.any():
        return 0.0, 0.0
    share, floor = (error / moved)[used], (1.5 * count * sigma**2 / moved)[used]
    return float(np.sqrt(share.sum() / floor.sum())), float(np.sqrt(share.mean()))
