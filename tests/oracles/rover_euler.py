"""A wheeled robot with its faults, integrated literally in tiny Euler steps, independent of the library."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

WHEEL_RADIUS, TRACK_WIDTH = 0.033, 0.16  # m
GRAVITY = 9.81  # m/s^2
RESPONSE = 0.05  # s, over which a wheel's acceleration is taken
Command = Callable[[float], tuple[float, float]]  # s -> wheel speeds, rad/s


def simulate(
    command: Command,
    times: np.ndarray,
    faults: Mapping[str, Mapping[str, float]],
    begin: float = 0.0,
    fine: float = 2e-4,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Poses (n, 3) m, m, rad at the times (n,) s, settled at `begin`; both wheels have the fault.

    The effects are written from their definitions: a fault is named and parametrised as in the library.
    """
    value = {f"{e}.{p}": v for e, ps in faults.items() for p, v in ps.items()}
    x, y, theta = pose
    settled = list(command(begin - value.get("command_delay.delay", 0.0)))
    ramp = list(settled)
    base = [sum(settled) / 2, (settled[1] - settled[0]) / 2]  # forward and turning, rad/s
    play = [0.5 * value.get("backlash.gap", 0.0) * _sign(w) for w in settled]  # motor minus wheel, rad
    turned = [0.0, 0.0]  # rad
    past: list[list[float]] = []  # wheel speeds so far, rad/s
    out = np.empty((len(times), 3))
    n = 0
    steps = int(round((times[-1] - begin) / fine)) + 1
    for k in range(steps):
        t = begin + k * fine
        while n < len(times) and times[n] <= t + 1e-9:
            out[n] = x, y, theta
            n += 1
        u = list(command(t - value.get("command_delay.delay", 0.0)))
        u = _ramped(u, base, fine, value)
        width = value.get("dead_zone.width", 0.0)
        u = [0.0 if abs(v) < width else v for v in u]
        loss = value.get("breakaway_loss.loss", 0.0)
        u = [v - min(max(v, -loss), loss) for v in u]
        most = fine * value.get("rate_limit.rate", math.inf)
        ramp = u = [r + min(max(v - r, -most), most) for r, v in zip(ramp, u, strict=True)]
        u = [v * value.get("actuator_gain.gain", 1.0) * (1.0 - value.get("voltage_sag.rate", 0.0) * t) for v in u]
        u = _steered(u, value)
        limit = value.get("saturation.limit", math.inf)
        u = [min(max(v, -limit), limit) for v in u]
        tau = value.get("actuator_lag.time_constant", 0.0)
        if tau > 0:
            settled = [s + fine / tau * (v - s) for s, v in zip(settled, u, strict=True)]
            u = settled
        w = list(u)
        gap = value.get("backlash.gap", 0.0)
        if gap > 0:
            for i in (0, 1):
                play[i] += u[i] * fine
                push = play[i] - min(max(play[i], -gap / 2), gap / 2)  # what exceeds the gap moves the wheel
                play[i] -= push
                w[i] = push / fine
        r_left = WHEEL_RADIUS * value.get("wheel_radius.scale", 1.0)
        r_right = r_left * value.get("wheel_radius_mismatch.ratio", 1.0)
        swing, phase = value.get("wheel_eccentricity.amplitude", 0.0), value.get("wheel_eccentricity.phase", 0.0)
        r_left *= 1.0 + swing * math.cos(turned[0] + phase)
        r_right *= 1.0 + swing * math.cos(turned[1] + phase)
        turned = [q + fine * v for q, v in zip(turned, w, strict=True)]
        past.append(list(w))
        ago = past[max(0, len(past) - 1 - round(RESPONSE / fine))]
        accel = [(a - b) / RESPONSE for a, b in zip(w, ago, strict=True)]
        slip = value.get("longitudinal_slip.coefficient", 0.0)
        left = r_left * w[0] * (1.0 - slip * abs(r_left * accel[0]) / GRAVITY)
        right = r_right * w[1] * (1.0 - slip * abs(r_right * accel[1]) / GRAVITY)
        v = (left + right) / 2
        omega = (right - left) / (TRACK_WIDTH * value.get("track_width.scale", 1.0))
        omega += value.get("gusts.size", 0.0) * math.sin(7.0 * t)  # rad/s; no effect of the library
        outwards = v * omega * value.get("lateral_slip.coefficient", 0.0)  # to the right in a turn to the left
        drift, heading = value.get("slope.rate", 0.0), value.get("slope.heading", 0.0)
        x += fine * (v * math.cos(theta) + outwards * math.sin(theta) + drift * math.cos(heading))
        y += fine * (v * math.sin(theta) - outwards * math.cos(theta) + drift * math.sin(heading))
        theta += fine * omega
    out[n:] = x, y, theta
    return out


def _ramped(u: list[float], base: list[float], fine: float, value: Mapping[str, float]) -> list[float]:
    """Wheel speeds, rad/s, of a base that speeds up and turns no faster than its limits; moves `base`, its forward and
    turning speed."""
    wanted = (u[0] + u[1]) / 2, (u[1] - u[0]) / 2
    for i, name in enumerate(("forward_rate_limit.rate", "turn_rate_limit.rate")):
        ahead = wanted[i] - base[i]
        base[i] += math.copysign(min(abs(ahead), fine * value.get(name, math.inf)), ahead)
    return [base[0] - base[1], base[0] + base[1]]


def _steered(u: list[float], value: Mapping[str, float]) -> list[float]:
    """Wheel speeds, rad/s, as a base controller gives them that turns less or slows down on curves."""
    forward, turn = (u[0] + u[1]) / 2, (u[1] - u[0]) / 2 * value.get("turn_gain.gain", 1.0)
    fastest = value.get("turn_limit.limit", math.inf)
    turn = math.copysign(min(abs(turn), fastest), turn)
    share = value.get("shared_limit.limit", math.inf) / max(abs(forward - turn), abs(forward + turn), 1e-9)
    return [min(share, 1.0) * w for w in (forward - turn, forward + turn)]


def _sign(w: float) -> float:
    return float(np.sign(w))
