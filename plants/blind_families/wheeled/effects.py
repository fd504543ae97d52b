"""From a library effect and a strength to the truth that has it, for a wheeled robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plants.blind_families.wheeled.truth import WheeledTruth

SIDES = ("left", "right")


@dataclass(frozen=True)
class PoseSensor:
    """The localisation as it really is."""

    delay: float = 0.0  # s
    bias: float = 0.0  # rad, of the heading
    mounting: tuple[float, float] = (0.0, 0.0)  # m, in the body frame
    outliers: float = 0.0  # share of the samples


@dataclass(frozen=True)
class Rover:
    """Truth and sensor of one case."""

    truth: WheeledTruth
    sensor: PoseSensor


@dataclass(frozen=True)
class Draw:
    """What is drawn once for an effect; the strength alone is then tuned."""

    effect: str
    target: str | None
    sign: float
    angle: float  # rad


def _pair(draw: Draw, null: float, value: float) -> tuple[float, float]:
    return (
        value if draw.target in (None, "left") else null,
        value if draw.target in (None, "right") else null,
    )


def _per_wheel(field: str, parameter: str, null: float, law: Callable[[float, Draw, WheeledTruth], float]) -> Any:
    def plant(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
        value = law(s, draw, rover.truth)
        changes: dict[str, Any] = {field: _pair(draw, null, value)}
        return replace(rover, truth=replace(rover.truth, **changes)), {parameter: value}

    return plant


def _whole(field: str, parameter: str, law: Callable[[float, Draw, WheeledTruth], float]) -> Any:
    def plant(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
        value = law(s, draw, rover.truth)
        changes: dict[str, Any] = {field: value}
        return replace(rover, truth=replace(rover.truth, **changes)), {parameter: value}

    return plant


def _radius(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    value = 1 + draw.sign * 0.25 * s
    left, right = rover.truth.radius
    return replace(rover, truth=replace(rover.truth, radius=(left * value, right * value))), {"scale": value}


def _mismatch(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    value = 1 + draw.sign * 0.2 * s
    left, right = rover.truth.radius
    return replace(rover, truth=replace(rover.truth, radius=(left, right * value))), {"ratio": value}


def _slope(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    truth = replace(rover.truth, drift=0.12 * s, drift_heading=draw.angle)
    return replace(rover, truth=truth), {"rate": 0.12 * s, "heading": draw.angle}


def _sensor_delay(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    return replace(rover, sensor=replace(rover.sensor, delay=0.25 * s)), {"delay": 0.25 * s}


def _sensor_bias(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    value = draw.sign * 0.4 * s
    return replace(rover, sensor=replace(rover.sensor, bias=value)), {"bias": value}


def _mounting(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    x, y = 0.4 * s * np.cos(draw.angle), 0.4 * s * np.sin(draw.angle)
    return replace(rover, sensor=replace(rover.sensor, mounting=(x, y))), {"x": float(x), "y": float(y)}


def _outliers(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    return replace(rover, sensor=replace(rover.sensor, outliers=0.08 * s)), {"rate": 0.08 * s}


Plant = Callable[[Rover, Draw, float], tuple[Rover, dict[str, float]]]
# strength 1 is about as far as a robot that still drives would go
PLANT: dict[str, Plant] = {
    "command_delay": _per_wheel("delay", "delay", 0.0, lambda s, d, p: 0.25 * s),
    "dead_zone": _per_wheel("dead_zone", "width", 0.0, lambda s, d, p: 0.5 * p.speed_scale * s),
    "actuator_lag": _per_wheel("lag", "time_constant", 0.0, lambda s, d, p: 0.4 * s),
    "actuator_gain": _per_wheel("gain", "gain", 1.0, lambda s, d, p: 1 + d.sign * 0.4 * s),
    "saturation": _per_wheel("limit", "limit", float("inf"), lambda s, d, p: p.speed_scale * (1 - 0.75 * s)),
    "voltage_sag": _whole("sag", "rate", lambda s, d, p: 0.025 * s),
    "backlash": _per_wheel("gap", "gap", 0.0, lambda s, d, p: 1.0 * s),
    "wheel_radius": _radius,
    "wheel_radius_mismatch": _mismatch,
    "track_width": _whole("track", "scale", lambda s, d, p: 1 + d.sign * 0.4 * s),
    "lateral_slip": _whole("lateral", "coefficient", lambda s, d, p: 0.35 * s),
    "longitudinal_slip": _whole("slip", "coefficient", lambda s, d, p: 4.0 * s),
    "slope": _slope,
    "sensor_delay": _sensor_delay,
    "sensor_bias": _sensor_bias,
    "sensor_mounting": _mounting,
    "sensor_outliers": _outliers,
}
PER_WHEEL = ("dead_zone", "actuator_lag", "actuator_gain", "saturation", "backlash")
# share of full strength that is typical of a strong case: a tenth of it is a faint background
TYPICAL = {
    "command_delay": 0.25,
    "dead_zone": 0.3,
    "actuator_lag": 0.25,
    "actuator_gain": 0.25,
    "saturation": 0.0,
    "voltage_sag": 0.4,
    "backlash": 0.35,
    "wheel_radius": 0.3,
    "wheel_radius_mismatch": 0.2,
    "track_width": 0.3,
    "lateral_slip": 0.3,
    "longitudinal_slip": 0.4,
    "slope": 0.3,
    "sensor_delay": 0.25,
    "sensor_bias": 0.3,
    "sensor_mounting": 0.3,
    "sensor_outliers": 0.1,
}


def draw_effect(effect: str, encoders: bool, rng: np.random.Generator) -> Draw:
    """Target, sign and direction of ``effect``."""
    target: str | None = None
    if effect in PER_WHEEL:
        target = (None, None, "left", "right")[rng.integers(4)]
    elif effect == "sensor_bias":
        target = "pose.theta"
    elif effect == "sensor_delay" and encoders:
        target = "pose"
    return Draw(effect, target, float(rng.choice([-1, 1])), float(rng.uniform(-np.pi, np.pi)))
