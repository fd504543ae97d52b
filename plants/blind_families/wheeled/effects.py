"""From a library effect and a strength to the truth that has it, for a wheeled robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from plants.blind_families.planting import Confounded, Faint, Planting, Plantings, by_name
from plants.blind_families.wheeled.base_controller import Steering
from plants.blind_families.wheeled.truth import WheeledTruth
from residual_mpc.effects.actuator import ACTUATOR_GAIN, ACTUATOR_LAG, BACKLASH, SATURATION, VOLTAGE_SAG
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE
from residual_mpc.effects.contact import (
    LATERAL_SLIP,
    LONGITUDINAL_SLIP,
    SLOPE,
    TRACK_WIDTH,
    WHEEL_ECCENTRICITY,
    WHEEL_RADIUS,
    WHEEL_RADIUS_MISMATCH,
)
from residual_mpc.effects.drive import SHARED_LIMIT, TURN_GAIN, TURN_LIMIT
from residual_mpc.effects.sensor import CLOCK_SKEW, SENSOR_BIAS, SENSOR_DELAY, SENSOR_MOUNTING, SENSOR_OUTLIERS

SIDES = ("left", "right")


@dataclass(frozen=True)
class PoseSensor:
    """The localisation as it really is."""

    delay: float = 0.0  # s
    skew: float = 0.0  # s that its clock gains in a second
    bias: float = 0.0  # rad, of the heading
    mounting: tuple[float, float] = (0.0, 0.0)  # m, in the body frame
    outliers: float = 0.0  # share of the samples
    # causes that no library names
    wander: tuple[tuple[float, float, float], ...] = ()  # (rad/s, rad, rad): slow swings of the heading, with phase
    magnetic: tuple[float, float] = (0.0, 0.0)  # rad, rad: swing of the heading over a turn, and its phase
    relocated: tuple[tuple[float, float, float, float], ...] = ()  # (s, m, m, rad): jumps of the map that stay


@dataclass(frozen=True)
class Rover:
    """Truth and sensor of one case."""

    truth: WheeledTruth
    sensor: PoseSensor
    changes: Mapping[str, tuple[float, Rover]] = field(default_factory=dict)  # by run: from when on (s) it is another

    def at(self, run: str) -> tuple[Rover, tuple[float, Rover] | None]:
        """The robot at the start of a run, and what becomes of it in the middle, if anything."""
        change = self.changes.get(run)
        return (self, None) if change is None else (change[1], None) if change[0] <= 0.0 else (self, change)


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


def _steered(field: str, parameter: str, law: Callable[[float, Draw, WheeledTruth], float]) -> Any:
    def plant(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
        value = law(s, draw, rover.truth)
        steering: Steering = replace(rover.truth.steering, **{field: value})
        return replace(rover, truth=replace(rover.truth, steering=steering)), {parameter: value}

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


def _skew(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    rate = draw.sign * 0.01 * s
    return replace(rover, sensor=replace(rover.sensor, skew=rate)), {"rate": rate}


def _eccentric(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    """Worn beside: a little of the radius varies twice a turn. The phase counts from the largest radius, since nothing
    tells how a wheel stood at a run's start."""
    truth = replace(rover.truth, eccentric=_pair(draw, 0.0, 0.4 * s), oval=0.08)
    return replace(rover, truth=truth), {"amplitude": 0.4 * s, "phase": 0.0}


def _sensor_bias(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    value = draw.sign * 0.4 * s
    return replace(rover, sensor=replace(rover.sensor, bias=value)), {"bias": value}


def _mounting(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    x, y = 0.4 * s * np.cos(draw.angle), 0.4 * s * np.sin(draw.angle)
    return replace(rover, sensor=replace(rover.sensor, mounting=(x, y))), {"x": float(x), "y": float(y)}


def _outliers(rover: Rover, draw: Draw, s: float) -> tuple[Rover, dict[str, float]]:
    return replace(rover, sensor=replace(rover.sensor, outliers=0.08 * s)), {"rate": 0.08 * s}


def _robot(encoders: bool, rng: np.random.Generator) -> str | None:
    return None


def _wheels(encoders: bool, rng: np.random.Generator) -> str | None:
    """Both of them as often as one."""
    return (None, None, "left", "right")[rng.integers(4)]


def _wheel(encoders: bool, rng: np.random.Generator) -> str | None:
    return SIDES[rng.integers(2)]


def _heading(encoders: bool, rng: np.random.Generator) -> str | None:
    return "pose.theta"


def _readings(encoders: bool, rng: np.random.Generator) -> str | None:
    """All of them; where there are encoders, those of the localisation."""
    return "pose" if encoders else None


Place = Callable[[bool, np.random.Generator], str | None]  # whether there are encoders -> the target
# groups of which a case holds one member at most
SIZES, DELAYS, DRIFTS = "sizes and gains of wheels", "delays", "motion to the side"
# what an effect needs of the runs
REVERSALS = "reversals"  # many of them: it acts where a wheel stands or turns back
NO_JERKS = "no jerks"  # a robot that slides is not driven with them
NO_ENCODERS = "no encoders"
ENCODERS = "encoders"

# Strength 1 is about as far as a robot that still drives would go. The first seven have a twin where there are no
# encoders, the last two of them on a straight line.
PLANTINGS: Plantings[Rover, Draw, Place] = by_name(
    Planting(WHEEL_RADIUS, _radius, _robot, typical=0.3, clashes=(SIZES,), confounded=Confounded()),
    Planting(
        COMMAND_DELAY,
        _per_wheel("delay", "delay", 0.0, lambda s, d, p: 0.25 * s),
        _robot,
        typical=0.25,
        clashes=(DELAYS,),
        confounded=Confounded(),
    ),
    Planting(SENSOR_DELAY, _sensor_delay, _readings, typical=0.25, clashes=(DELAYS,), confounded=Confounded()),
    Planting(WHEEL_RADIUS_MISMATCH, _mismatch, _robot, typical=0.2, clashes=(SIZES,), confounded=Confounded()),
    Planting(
        ACTUATOR_GAIN,
        _per_wheel("gain", "gain", 1.0, lambda s, d, p: 1 + d.sign * 0.4 * s),
        _wheels,
        typical=0.25,
        clashes=(SIZES,),
        confounded=Confounded(),
    ),
    Planting(SLOPE, _slope, _robot, typical=0.3, confounded=Confounded(straight=True)),
    Planting(
        LONGITUDINAL_SLIP,
        _whole("slip", "coefficient", lambda s, d, p: 4.0 * s),
        _robot,
        typical=0.4,
        needs=(NO_JERKS,),
        # a constant speed never slips: the group stands for it
        confounded=Confounded(straight=True, by=SLOPE),
    ),
    Planting(
        DEAD_ZONE,
        _per_wheel("dead_zone", "width", 0.0, lambda s, d, p: 0.5 * p.speed_scale * s),
        _wheels,
        typical=0.3,
        needs=(REVERSALS,),
    ),
    Planting(
        ACTUATOR_LAG,
        _per_wheel("lag", "time_constant", 0.0, lambda s, d, p: 0.4 * s),
        _wheels,
        typical=0.25,
        clashes=(DELAYS,),
    ),
    Planting(
        SATURATION,
        _per_wheel("limit", "limit", float("inf"), lambda s, d, p: p.speed_scale * (1 - 0.75 * s)),
        _wheels,
        typical=0.0,
        faint=Faint.NONE,
    ),
    Planting(VOLTAGE_SAG, _whole("sag", "rate", lambda s, d, p: 0.025 * s), _robot, typical=0.4, clashes=(SIZES,)),
    Planting(
        BACKLASH,
        _per_wheel("gap", "gap", 0.0, lambda s, d, p: 1.0 * s),
        _wheels,
        typical=0.35,
        needs=(REVERSALS, NO_ENCODERS),
    ),
    Planting(TRACK_WIDTH, _whole("track", "scale", lambda s, d, p: 1 + d.sign * 0.4 * s), _robot, typical=0.3),
    Planting(
        LATERAL_SLIP,
        _whole("lateral", "coefficient", lambda s, d, p: 0.35 * s),
        _robot,
        typical=0.3,
        clashes=(DRIFTS,),
    ),
    Planting(SENSOR_BIAS, _sensor_bias, _heading, typical=0.3, clashes=(DRIFTS,)),
    Planting(SENSOR_MOUNTING, _mounting, _robot, typical=0.3, clashes=(DRIFTS,)),
    Planting(SENSOR_OUTLIERS, _outliers, _robot, typical=0.1, faint=Faint.NONE, tuned=False),
)


# what takes a long run to show; drawn at a level of its own, so that the cases of the others stay
LONG_PLANTINGS: Plantings[Rover, Draw, Place] = by_name(
    Planting(CLOCK_SKEW, _skew, _readings, typical=0.2),
    Planting(WHEEL_ECCENTRICITY, _eccentric, _wheel, typical=0.2),
)
# what a base controller makes of two wheels' speeds; at a level of its own for the same reason
BASE_PLANTINGS: Plantings[Rover, Draw, Place] = by_name(
    Planting(
        TURN_GAIN,
        _steered("turn", "gain", lambda s, d, p: 1 + d.sign * 0.6 * s),
        _robot,
        typical=0.3,
        needs=(ENCODERS,),
    ),
    Planting(
        TURN_LIMIT,
        _steered("most_turn", "limit", lambda s, d, p: p.track_width / p.wheel_radius * (1 - 0.85 * s)),
        _robot,
        typical=0.3,
    ),
    Planting(
        SHARED_LIMIT,
        _steered("most_speed", "limit", lambda s, d, p: p.speed_scale * (1 - 0.75 * s)),
        _robot,
        typical=0.3,
    ),
)
EVERY: Plantings[Rover, Draw, Place] = {**PLANTINGS, **LONG_PLANTINGS, **BASE_PLANTINGS}


def draw_effect(effect: str, encoders: bool, rng: np.random.Generator) -> Draw:
    """Target, sign and direction of ``effect``."""
    target = EVERY[effect].place(encoders, rng)
    return Draw(effect, target, float(rng.choice([-1, 1])), float(rng.uniform(-np.pi, np.pi)))
