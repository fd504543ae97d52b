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
    delay, width = value.get("command_delay.delay", 0.0), value.get("dead_zone.width", 0.0)
    loss, most = value.get("breakaway_loss.loss", 0.0), fine * value.get("rate_limit.rate", math.inf)
    quicken, swerve = (fine * value.get(f"{way}_rate_limit.rate", math.inf) for way in ("forward", "turn"))
    gain, sag = value.get("actuator_gain.gain", 1.0), value.get("voltage_sag.rate", 0.0)
    turned_by, fastest = value.get("turn_gain.gain", 1.0), value.get("turn_limit.limit", math.inf)
    shared, limit = value.get("shared_limit.limit", math.inf), value.get("saturation.limit", math.inf)
    tau, gap = value.get("actuator_lag.time_constant", 0.0), value.get("backlash.gap", 0.0)
    radius = WHEEL_RADIUS * value.get("wheel_radius.scale", 1.0)
    other = radius * value.get("wheel_radius_mismatch.ratio", 1.0)
    swing, phase = value.get("wheel_eccentricity.amplitude", 0.0), value.get("wheel_eccentricity.phase", 0.0)
    slip, skid = value.get("longitudinal_slip.coefficient", 0.0), value.get("lateral_slip.coefficient", 0.0)
    track, gusts = TRACK_WIDTH * value.get("track_width.scale", 1.0), value.get("gusts.size", 0.0)
    drift, heading = value.get("slope.rate", 0.0), value.get("slope.heading", 0.0)
    drift_x, drift_y = drift * math.cos(heading), drift * math.sin(heading)
    x, y, theta = pose
    left, right = settled = ramp = command(begin - delay)
    forward, turn = (left + right) / 2, (right - left) / 2  # base, rad/s
    play = 0.5 * gap * _sign(left), 0.5 * gap * _sign(right)  # motor minus wheel, rad
    turned = 0.0, 0.0  # rad
    past: list[tuple[float, float]] = []  # wheel speeds so far, rad/s
    out = np.empty((len(times), 3))
    n, due = 0, [float(time) - 1e-9 for time in times]
    steps = int(round((times[-1] - begin) / fine)) + 1
    for k in range(steps):
        t = begin + k * fine
        while n < len(due) and due[n] <= t:
            out[n] = x, y, theta
            n += 1
        left, right = command(t - delay)
        forward += _within((left + right) / 2 - forward, quicken)  # a base speeds up and turns within its limits
        turn += _within((right - left) / 2 - turn, swerve)
        left, right = forward - turn, forward + turn
        if width:
            left, right = (0.0 if abs(u) < width else u for u in (left, right))
        if loss:
            left, right = left - _within(left, loss), right - _within(right, loss)
        ramp = left, right = ramp[0] + _within(left - ramp[0], most), ramp[1] + _within(right - ramp[1], most)
        left, right = left * gain * (1.0 - sag * t), right * gain * (1.0 - sag * t)
        ahead, around = (left + right) / 2, _within((right - left) / 2 * turned_by, fastest)
        left, right = ahead - around, ahead + around
        if shared < math.inf:  # a base that slows down on curves
            share = min(shared / max(abs(left), abs(right), 1e-9), 1.0)
            left, right = share * left, share * right
        left, right = _within(left, limit), _within(right, limit)
        if tau:
            settled = left, right = (
                settled[0] + fine / tau * (left - settled[0]),
                settled[1] + fine / tau * (right - settled[1]),
            )
        if gap:
            moved = play[0] + left * fine, play[1] + right * fine
            push = [p - _within(p, gap / 2) for p in moved]  # what exceeds the gap moves the wheel
            play = moved[0] - push[0], moved[1] - push[1]
            left, right = push[0] / fine, push[1] / fine
        r_left, r_right = radius, other
        if swing:
            r_left *= 1.0 + swing * math.cos(turned[0] + phase)
            r_right *= 1.0 + swing * math.cos(turned[1] + phase)
            turned = turned[0] + fine * left, turned[1] + fine * right
        v_left, v_right = r_left * left, r_right * right  # m/s
        if slip:
            past.append((left, right))
            ago = past[max(0, len(past) - 1 - round(RESPONSE / fine))]
            v_left *= 1.0 - slip * abs(r_left * ((left - ago[0]) / RESPONSE)) / GRAVITY
            v_right *= 1.0 - slip * abs(r_right * ((right - ago[1]) / RESPONSE)) / GRAVITY
        v, omega = (v_left + v_right) / 2, (v_right - v_left) / track
        if gusts:
            omega += gusts * math.sin(7.0 * t)  # rad/s; no effect of the library
        outwards, cos, sin = v * omega * skid, math.cos(theta), math.sin(theta)  # to the right in a turn to the left
        x += fine * (v * cos + outwards * sin + drift_x)
        y += fine * (v * sin - outwards * cos + drift_y)
        theta += fine * omega
    out[n:] = x, y, theta
    return out


def _within(x: float, limit: float) -> float:
    return -limit if x < -limit else limit if x > limit else x


def _sign(w: float) -> float:
    return float(np.sign(w))
