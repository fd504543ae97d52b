"""A wheeled robot as it really is: motors, gears, tyres and a battery, stepped finely in plain Python.

Written apart from the candidates on purpose. Where a candidate is a one-line law, the truth has a state of
its own: the motor is current-limited and of second order, play is two inertias and two stops, a sideways slip
is a saturating tyre that takes time, a slip along the wheel relaxes over a contact length, the battery
empties with the load. A trajectory is a list of fine steps; sensors look at it afterwards.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, cos, exp, hypot, inf, sin, tanh
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from plants.blind_families.wheeled.base_controller import BaseController, Steering

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s^2
STEP = 1e-3  # s, longest fine step
_SIDE_LIMIT = 0.5  # m/s, fastest sideways drift
_SIDE_TIME = 0.05  # s, relaxation of the tyre sideways
_SLIP_LIMIT = 0.6  # 1, slip ratio at full sliding
_CONTACT_TIME = 0.04  # s, relaxation of the contact patch
_GEAR_FREQUENCY = 600.0  # rad/s, wheel against the closed gear
_WHEEL_DRAG_TIME = 0.02  # s, a wheel let loose in its gap stops in this time
_HEAT_TIME = 3.0  # s
_TRAIL = 0.15  # track widths that a castor trails behind its pivot
_SCRUB_TIME = 0.12  # s
_SCRUB_RATE = 0.7  # rad/s, yaw rate at which half of the scrub has come


@dataclass(frozen=True)
class WheeledTruth:
    """Every constant of the truth; the defaults are the nominal robot. Pairs are (left, right)."""

    wheel_radius: float  # m
    track_width: float  # m
    speed_scale: float  # rad/s, a brisk wheel speed: scales current limit and battery load
    delay: tuple[float, float] = (0.0, 0.0)  # s
    dead_zone: tuple[float, float] = (0.0, 0.0)  # rad/s
    lag: tuple[float, float] = (0.0, 0.0)  # s
    gain: tuple[float, float] = (1.0, 1.0)
    limit: tuple[float, float] = (inf, inf)  # rad/s
    sag: float = 0.0  # 1/s at average load
    gap: tuple[float, float] = (0.0, 0.0)  # rad, stop to stop
    radius: tuple[float, float] = (1.0, 1.0)
    track: float = 1.0
    lateral: float = 0.0  # s
    slip: float = 0.0
    drift: float = 0.0  # m/s
    drift_heading: float = 0.0  # rad
    eccentric: tuple[float, float] = (0.0, 0.0)  # relative swing of the radius over a turn of the wheel
    oval: float = 0.0  # share of that swing that comes twice a turn
    steering: Steering = Steering()
    standing: float = 0.0  # rad, by which the wheels are turned when the run begins
    # causes that no library names
    one_sided: float = 0.0  # share of the yaw rate lost in left turns
    warm_up: float = 0.0  # share of the speed lost when cold
    warm_up_time: float = 6.0  # s
    gusts: tuple[tuple[float, float, float, float, float], ...] = ()  # (from s, to s, m/s, m/s, rad/s)
    castor: float = 0.0  # share of the speed by which a castor that swivels round pushes the robot about
    nap: float = 0.0  # share of the speed that a carpet takes along its nap and turns aside across it
    nap_heading: float = 0.0  # rad
    heat: float = 0.0  # share of the speed lost when a motor is hot; it cools again
    # ways in which the nominal model is wrong
    servo: float = 0.0  # speed error of a wheel whose servo has no integral part, as a share of ``speed_scale``
    servo_time: float = 0.08  # s
    scrub: float = 0.0  # share of the yaw rate lost in the tightest turns, after a while
    soft: float = 0.0  # share of the speed that soft tyres lose at ``speed_scale``
    # waves of an uneven floor: (1/m, 1/m, rad, share of the speed along, rad/m of turning)
    floor: tuple[tuple[float, float, float, float, float], ...] = ()


@dataclass(frozen=True)
class Trajectory:
    """What happened, on the fine grid. ``t``, ``x``, ``y``, ``theta``: (m,); ``motor``: (m, 2) rad/s in
    wheel terms, before any play: where an encoder sits, by the product's convention too."""

    t: Array
    x: Array
    y: Array
    theta: Array
    motor: Array
    command: Array  # (n, 2) rad/s, one row a sample

    def pose(self, t: Array) -> Array:
        """True pose (k, 3) at times ``t`` (k,), the first pose before the start."""
        return np.stack([np.interp(t, self.t, c) for c in (self.x, self.y, self.theta)], axis=1)


Policy = Callable[[int, float, float, float], tuple[float, float]]


class Simulator(Protocol):
    """A way to step a truth through a run; see ``simulate``."""

    def __call__(
        self,
        truth: WheeledTruth,
        t: Array,
        policy: Policy,
        play: tuple[float, float] = (0.0, 0.0),
        *,
        change: tuple[float, WheeledTruth] | None = None,
    ) -> Trajectory: ...


class Drive:
    """One wheel: command to wheel speed. A leaf with explicit memory, one instance a run."""

    def __init__(self, truth: WheeledTruth, side: int, play: float):
        self.truth, self.side = truth, side
        self.events: list[tuple[float, float]] = []
        self.next, self.held = 0, 0.0
        self.moving = False
        self.speed, self.acceleration = 0.0, 0.0  # motor side
        self.wheel, self.twist = 0.0, play * truth.gap[side]  # wheel speed, motor minus wheel angle
        self.motor = 0.0  # mean speed over the last step
        self.driven, self.heat = 0.0, 0.0  # speed behind an own servo; share of the heat that a motor can have

    def send(self, t: float, value: float) -> None:
        self.events.append((t + self.truth.delay[self.side], value))

    def _arrived(self, t: float, h: float) -> float:
        """Mean of the delayed, held command over [t, t + h]: exact for whatever integrates it."""
        total, at = 0.0, t
        while self.next < len(self.events) and self.events[self.next][0] < t + h - 1e-12:
            when, value = self.events[self.next]
            when = max(when, at)
            total += self.held * (when - at)
            at, self.held, self.next = when, value, self.next + 1
        return (total + self.held * (t + h - at)) / h

    def step(self, t: float, h: float, charge: float) -> float:
        """Mean wheel speed (rad/s) over [t, t + h]."""
        p, i = self.truth, self.side
        u = self._arrived(t, h)
        if p.dead_zone[i] > 0.0:
            edge = p.dead_zone[i] * (0.98 if self.moving else 1.02)  # a little hysteresis, as drivers have
            self.moving = abs(u) >= edge
            u = u if self.moving else 0.0
        u *= p.gain[i] * charge
        if p.limit[i] < inf:
            u /= (1.0 + (abs(u) / p.limit[i]) ** 14) ** (1.0 / 14)
        if p.lag[i] > 0.0:
            before = self.speed
            current_time = p.lag[i] / 10.0
            most = 1.2 * p.speed_scale / p.lag[i]
            wanted = (u - self.speed) / p.lag[i]  # the current's own lag costs no way in the end
            wanted = min(max(wanted, -most), most)
            self.acceleration += (wanted - self.acceleration) * (1.0 - exp(-h / current_time))
            self.speed += self.acceleration * h
            u = 0.5 * (before + self.speed)
        else:
            self.speed = u
        if p.servo > 0.0:
            u = self._servo(u, h)
        if p.heat > 0.0:
            self.heat += (min(abs(u) / p.speed_scale, 1.5) ** 2 - self.heat) * (1.0 - exp(-h / _HEAT_TIME))
            u *= 1.0 - p.heat * self.heat
        self.motor = u
        return self._through_gear(u, h) if p.gap[i] > 0.0 else u

    def _servo(self, wanted: float, h: float) -> float:
        """A proportional speed loop: friction and drag leave an error, the more so near standstill."""
        p, w = self.truth, self.driven
        share = w / p.speed_scale
        rub = (0.4 + 0.6 * exp(-abs(share) / 0.15)) * tanh(share / 0.02) + 0.8 * share * abs(share)
        self.driven += h / p.servo_time * (wanted - w - p.servo * p.speed_scale * rub)
        return 0.5 * (w + self.driven)

    def _through_gear(self, motor: float, h: float) -> float:
        half, k = 0.5 * self.truth.gap[self.side], _GEAR_FREQUENCY**2
        c, n, travelled = 1.4 * _GEAR_FREQUENCY, 8, 0.0
        for _ in range(n):
            squeeze = self.twist - min(max(self.twist, -half), half)
            push = 0.0
            if squeeze != 0.0:
                push = k * squeeze + c * (motor - self.wheel)
                push = max(push, 0.0) if squeeze > 0.0 else min(push, 0.0)  # stops push, they never pull
            self.wheel += h / n * (push - self.wheel / _WHEEL_DRAG_TIME)
            self.twist += h / n * (motor - self.wheel)
            travelled += self.wheel / n
        return travelled


def simulate(
    truth: WheeledTruth,
    t: Array,
    policy: Policy,
    play: tuple[float, float] = (0.0, 0.0),
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    change: tuple[float, WheeledTruth] | None = None,
) -> Trajectory:
    """Drive through the stamps ``t`` (n,) s; ``policy(k, x, y, theta)`` gives the commands sent at ``t[k]``.

    ``play`` says where in its gap each wheel starts, from -0.5 to 0.5. A command acts after its stamp. ``change``:
    the truth that takes over, and from when on (s).
    """
    p = truth
    wheels, base = (Drive(p, 0, play[0]), Drive(p, 1, play[1])), BaseController()
    x, y, theta = start
    used, sideways, drift = 0.0, 0.0, p.drift
    angle, contact, last = [p.standing, -p.standing], [0.0, 0.0], [0.0, 0.0]
    swivel, scrubbed = 0.1, 0.0  # rad of the castor; share of the yaw rate lost
    rows: list[tuple[float, float, float, float, float, float]] = [(float(t[0]), x, y, theta, 0.0, 0.0)]
    sent: list[tuple[float, float]] = []
    stamps = [float(v) for v in t] + [float(t[-1])]
    gusts = p.gusts
    for k in range(len(t)):
        now, until = stamps[k], stamps[k + 1]
        if change is not None and now >= change[0]:
            p = wheels[0].truth = wheels[1].truth = change[1]
        command = policy(k, x, y, theta)
        sent.append(command)
        if not p.steering.idle:
            command = base(p.steering, *command, until - now)
        wheels[0].send(now, command[0])
        wheels[1].send(now, command[1])
        n = ceil((until - now) / STEP - 1e-9)
        for j in range(n):
            h = (until - now) / n
            at = now + j * h
            charge = max(1.0 - used, 0.05) * (1.0 - p.warm_up * exp(-(at - stamps[0]) / p.warm_up_time))
            ground, speed = [0.0, 0.0], [0.0, 0.0]
            for i in (0, 1):
                w = speed[i] = wheels[i].step(at, h, charge)
                r = p.wheel_radius * p.radius[i]
                if p.eccentric[i] != 0.0:
                    r *= 1.0 + p.eccentric[i] * (sin(angle[i] + i) + p.oval * sin(2.0 * angle[i]))
                    angle[i] += w * h
                v = r * w
                if p.slip > 0.0:
                    fade = exp(-h / _CONTACT_TIME)
                    contact[i] = contact[i] * fade + (v - last[i]) * (1.0 - fade) / h
                    last[i] = v
                    v *= 1.0 - _SLIP_LIMIT * tanh(p.slip * abs(contact[i]) / GRAVITY / _SLIP_LIMIT)
                if p.soft > 0.0:
                    v *= 1.0 - p.soft * (abs(w) / p.speed_scale) ** 1.5
                ground[i] = v
            forward = 0.5 * (ground[0] + ground[1])
            yaw = (ground[1] - ground[0]) / (p.track_width * p.track)
            if p.one_sided and yaw > 0.0:
                yaw *= 1.0 - p.one_sided
            if p.lateral > 0.0:
                # a contact that takes time to build up, and saturates
                wanted = _SIDE_LIMIT * tanh(p.lateral * forward * yaw / _SIDE_LIMIT)
                sideways += (wanted - sideways) * (1.0 - exp(-h / _SIDE_TIME))
            vx, vy = 0.0, 0.0
            if p.scrub > 0.0:
                wanted = p.scrub * abs(yaw) / (abs(yaw) + _SCRUB_RATE)
                scrubbed += (wanted - scrubbed) * (1.0 - exp(-h / _SCRUB_TIME))
                yaw *= 1.0 - scrubbed
            if p.floor:
                height = [(sin(kx * x + ky * y + phase), a, b) for kx, ky, phase, a, b in p.floor]
                yaw += forward * sum(z * b for z, _, b in height)
                forward *= 1.0 + sum(z * a for z, a, _ in height)
            if p.castor > 0.0:
                swivel -= h * (forward / (_TRAIL * p.track_width) * sin(swivel) + yaw)
                yaw -= p.castor * abs(forward) / p.track_width * sin(swivel)
            if p.drift:
                drift += h / 0.05 * (p.drift * (0.95 + 0.1 * tanh(abs(forward) / 0.1)) - drift)
                vx, vy = drift * cos(p.drift_heading), drift * sin(p.drift_heading)
            if p.nap > 0.0:  # the heading, mirrored at the nap
                vx -= p.nap * forward * cos(2.0 * p.nap_heading - theta)
                vy -= p.nap * forward * sin(2.0 * p.nap_heading - theta)
            for begin, end, gx, gy, gw in gusts:
                if begin <= at < end:
                    shape = sin(np.pi * (at - begin) / (end - begin))
                    vx, vy, yaw = vx + gx * shape, vy + gy * shape, yaw + gw * shape
            middle = theta + 0.5 * h * yaw
            c, s = cos(middle), sin(middle)
            x += h * (forward * c + sideways * s + vx)
            y += h * (forward * s - sideways * c + vy)
            theta += h * yaw
            used += h * p.sag * (0.7 + 0.3 * hypot(*speed) / (0.6 * p.speed_scale))
            rows.append((at + h, x, y, theta, wheels[0].motor, wheels[1].motor))
    table = np.array(rows)
    return Trajectory(table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4:6], np.array(sent))
