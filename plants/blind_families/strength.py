"""How strong an effect is: what it adds to the one-second gap of a log, over the noise floor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def planar_ratio(
    runs: list[tuple[Array, Array, Array]],
    wheel_radius: float,
    track_width: float,
    sigma: tuple[float, float],
    horizon: float = 1.0,
) -> float:
    """Noise-free gap of the ideal robot over its noise floor, for planar poses.

    ``runs`` holds (t (n,) s, measured pose (n, 3) without noise, commands (n, 2) rad/s); ``sigma`` is the
    noise of the position (m) and the heading (rad). Written apart from the program's own gap, as a second
    opinion.
    """
    foretold = [(t, pose, dead_reckoned(t, command, wheel_radius, track_width)) for t, pose, command in runs]
    return planar_gap(foretold, sigma, horizon)[0]


def planar_gap(
    runs: list[tuple[Array, Array, Array]], sigma: tuple[float, float], horizon: float = 1.0
) -> tuple[float, float]:
    """(gap over noise floor, gap) of a model that foretells whole runs.

    ``runs`` holds (t (n,) s, pose (n, 3) without noise, foretold pose (n, 3)). Each window starts at the noise-free
    pose, so that what is foretold need only be right as a motion.
    """
    squares, moved, floors = np.zeros(2), np.zeros(2), np.zeros(2)
    count = 0
    start_variance = 17.0 / 35.0  # of the middle value of a quadratic through five samples
    for t, pose, foretold in runs:
        x, y, heading = foretold.T
        for begin in np.arange(0.0, t[-1] - horizon + 1e-9, horizon):
            inside = np.flatnonzero((t >= begin - 1e-9) & (t <= begin + horizon + 1e-9))
            a = inside[0]
            turn = pose[a, 2] - heading[a]
            c, s = np.cos(turn), np.sin(turn)
            dx, dy = x[inside] - x[a], y[inside] - y[a]
            ex = pose[inside, 0] - pose[a, 0] - (c * dx - s * dy)
            ey = pose[inside, 1] - pose[a, 1] - (s * dx + c * dy)
            eh = pose[inside, 2] - heading[inside] - turn
            squares += [np.sum(ex**2 + ey**2), np.sum(eh**2)]
            gone = pose[inside] - pose[a]
            moved += [np.sum(gone[:, :2] ** 2), np.sum(gone[:, 2] ** 2)]
            lever = start_variance * sigma[1] ** 2 * (dx**2 + dy**2)
            floors += [
                np.sum(2 * sigma[0] ** 2 * (1 + start_variance) + lever),
                len(inside) * sigma[1] ** 2 * (1 + start_variance),
            ]
            count += len(inside)
    # still channels are left out, as the gap does
    used = moved / count > 9 * np.array([2 * sigma[0] ** 2, sigma[1] ** 2])
    weight = np.where(used, 1.0 / np.where(used, moved, 1.0), 0.0)
    gap = np.sqrt(np.sum(weight * squares) / max(float(used @ [2, 1]), 1.0))  # x and y are two channels
    return float(np.sqrt(np.sum(weight * squares) / np.sum(weight * floors))), float(gap)


def dead_reckoned(t: Array, command: Array, wheel_radius: float, track_width: float) -> Array:
    """Pose (n, 3) of the ideal robot from the origin, along the exact arcs of its wheel speeds (n, 2) rad/s."""
    dt = np.diff(t)
    v = 0.5 * wheel_radius * command.sum(axis=1)[:-1]
    w = (wheel_radius * (command[:, 1] - command[:, 0]) / track_width)[:-1]
    heading = np.concatenate([[0.0], np.cumsum(w * dt)])
    chord = v * dt * np.sinc(w * dt / 2 / np.pi)
    x = np.concatenate([[0.0], np.cumsum(chord * np.cos(heading[:-1] + w * dt / 2))])
    y = np.concatenate([[0.0], np.cumsum(chord * np.sin(heading[:-1] + w * dt / 2))])
    return np.stack([x, y, heading], axis=1)


def tuned(ratio_of: Callable[[float], float], wanted: float, start: float = 0.3, tries: int = 6) -> tuple[float, float]:
    """Strength in (0, 1] at which ``ratio_of(strength)`` is about ``wanted``, and the ratio reached.

    A secant in logarithms: ratios grow with a strength to about the first power.
    """
    strength, best = start, (start, 0.0)
    for _ in range(tries):
        ratio = ratio_of(strength)
        if best[1] == 0.0 or abs(np.log(max(ratio, 1e-6) / wanted)) < abs(np.log(max(best[1], 1e-6) / wanted)):
            best = (strength, ratio)
        if 0.8 < ratio / wanted < 1.25:
            break
        following = float(np.clip(strength * np.clip(wanted / max(ratio, 1e-6), 0.15, 4.0), 1e-3, 1.0))
        if following == strength:
            break
        strength = following
    return best
