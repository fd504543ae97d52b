"""Changes of what the sensors report, put into the log."""

from __future__ import annotations

import numpy as np

from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target, between, factor, refuse, signed
from residual_mpc.blind.recorded.log import FloatArray, Log
from residual_mpc.effects.ops import NUMPY
from residual_mpc.effects.sensor import SENSOR_BIAS, SENSOR_MOUNTING, SENSOR_OUTLIERS, SENSOR_SCALE, mounted

POSE = ("pose.x", "pose.y", "pose.theta")
STILL = 1e-6  # rms about the mean (rad, m): a channel below it does not move


def _moving(half: Half, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(c for c in half.measured if (c in names or c.startswith("position.")) and half.spread(c) > STILL)


def _offset_targets(half: Half) -> tuple[Target, ...]:
    found = _moving(half, ("pose.theta", "twist.theta"))
    if not found:
        raise refuse("sensor_bias", "no run measures a position, a heading or a yaw rate that moves")
    return found


def _offset(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    spread = min(half.spread(str(target)), 1.0)
    return {"bias": signed(rng) * spread * between(0.02, 0.6, strength)}


def _add_offset(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    return half.with_logs(lambda log: log.with_values([str(target)], lambda y: y + sizes["bias"]))


def _scale_targets(half: Half) -> tuple[Target, ...]:
    found = _moving(half, ())
    if not found:  # a yaw rate that is scaled is what other wheels give
        raise refuse(SENSOR_SCALE.name, "no run measures a joint's position that moves")
    return found


def _scale(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"scale": factor(0.01, 0.3, strength, rng)}


def _multiply(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    return half.with_logs(lambda log: log.with_values([str(target)], lambda y: y * sizes["scale"]))


def _mounting_targets(half: Half) -> tuple[Target, ...]:
    if not set(POSE) <= set(half.measured):
        raise refuse("sensor_mounting", "a run lacks pose.x, pose.y or pose.theta")
    if {"twist.x", "twist.y"} & {c for log in half.logs for c in log.columns}:
        raise refuse("sensor_mounting", "the point's measured velocity would have to change as well")
    for log in half.logs:
        x, y, theta = (np.isfinite(log.columns[c].values) for c in POSE)
        if np.any((x | y) & ~theta):
            raise refuse("sensor_mounting", f"run {log.name} has positions without a heading")
    return (None,)


def _mounting(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    arm = between(0.03, 0.8, strength) * half.settings[0].parameters.get("track_width", 0.3)
    angle = rng.uniform(-np.pi, np.pi)
    return {"x": float(arm * np.cos(angle)), "y": float(arm * np.sin(angle))}


def _mount(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def moved(log: Log) -> Log:
        x, y, theta = (log.columns[c].values for c in POSE)
        new = dict(zip(POSE, mounted(NUMPY, dict(sizes), x, y, theta), strict=False))
        return log.with_values(["pose.x"], lambda _: new["pose.x"]).with_values(["pose.y"], lambda _: new["pose.y"])

    return half.with_logs(moved)


def _outlier_targets(half: Half) -> tuple[Target, ...]:
    if not _jumping(half):
        raise refuse("sensor_outliers", "no run measures a pose, a position or a yaw rate")
    return (None,)


def _jumping(half: Half) -> tuple[tuple[str, ...], ...]:
    """The channels that jump together: a pose as a whole, every joint for itself."""
    if {"pose.x", "pose.y"} <= set(half.measured):
        return (("pose.x", "pose.y"),)
    return tuple((c,) for c in _moving(half, ("twist.theta",)))


def _outliers(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"rate": between(0.004, 0.1, strength)}


def _jump(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    for names in _jumping(half):
        spread = max(half.spread(c) for c in names)
        counts = [int(np.isfinite(log.columns[names[0]].values).sum()) for log in half.logs]
        # the share holds over all runs together, since a short run may have less than one outlier
        chosen = np.sort(rng.permutation(sum(counts))[: round(sizes["rate"] * sum(counts))])
        begins = np.concatenate([[0], np.cumsum(counts)])
        logs = []
        for log, low, high in zip(half.logs, begins[:-1], begins[1:], strict=True):
            own = chosen[(chosen >= low) & (chosen < high)] - low
            for c in names:
                jumps = rng.choice((-1.0, 1.0), len(own)) * spread * rng.uniform(0.7, 3.0, len(own))
                log = log.with_values([c], lambda y, own=own, jumps=jumps: _jumped(y, own, jumps))  # type: ignore[misc]
            logs.append(log)
        half = Half(half.robot, half.plant, tuple(logs), half.settings, half.payload_site)
    return half


def _jumped(y: FloatArray, own: FloatArray, jumps: FloatArray) -> FloatArray:
    new, seen = y.copy(), np.flatnonzero(np.isfinite(y))
    new[seen[own]] += jumps
    return new


BIAS = Kind(
    SENSOR_BIAS.name, "log",
    "The column is what the sensor reported. A constant on it is what the same sensor with that offset would have "
    "reported, whatever the robot did.",
    "reading", _offset_targets, _offset, _add_offset, rank=2,
)  # fmt: skip
SCALE = Kind(
    SENSOR_SCALE.name, "log",
    "As with a bias: the same reading, multiplied.",
    "reading", _scale_targets, _scale, _multiply, rank=1,
)  # fmt: skip
MOUNTING = Kind(
    SENSOR_MOUNTING.name, "log",
    "The point at (x, y) of the body is at the logged position plus (x, y) turned by the logged heading; the "
    "heading's noise enters times the lever.",
    "mounting", _mounting_targets, _mounting, _mount,
)  # fmt: skip
OUTLIERS = Kind(
    SENSOR_OUTLIERS.name, "log",
    "The stated share of the samples, drawn at random, is moved by 0.7 to 3 times the channel's spread; the others "
    "stay.",
    "outliers", _outlier_targets, _outliers, _jump, rank=3, directed=False,
)  # fmt: skip
