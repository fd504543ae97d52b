"""What goes wrong with a rover besides constant effects: causes without a name, flaws of its model, effects that come
and go; and which effects are easily mistaken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from plants.blind_families.wheeled.effects import PLANTINGS, Draw, Rover
from residual_mpc.effects.actuator import ACTUATOR_GAIN, ACTUATOR_LAG, BACKLASH, SATURATION, VOLTAGE_SAG
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE
from residual_mpc.effects.contact import (
    LATERAL_SLIP,
    LONGITUDINAL_SLIP,
    SLOPE,
    TRACK_WIDTH,
    WHEEL_RADIUS,
    WHEEL_RADIUS_MISMATCH,
)
from residual_mpc.effects.sensor import SENSOR_BIAS, SENSOR_DELAY, SENSOR_MOUNTING

PAIRS: tuple[tuple[str, str], ...] = tuple(
    (a.name, b.name)
    for a, b in (
        (COMMAND_DELAY, ACTUATOR_LAG),
        (SENSOR_DELAY, ACTUATOR_LAG),
        (WHEEL_RADIUS, WHEEL_RADIUS_MISMATCH),
        (ACTUATOR_GAIN, VOLTAGE_SAG),
        (WHEEL_RADIUS, VOLTAGE_SAG),
        (DEAD_ZONE, BACKLASH),
        (SENSOR_MOUNTING, LATERAL_SLIP),
    )
)
# what is small over a second and adds up
SLOW = tuple(e.name for e in (WHEEL_RADIUS_MISMATCH, TRACK_WIDTH, SLOPE, SENSOR_BIAS, VOLTAGE_SAG))
# what a puncture, a load, a worn motor, another computer do in the middle of a day
CHANGING = tuple(
    e.name
    for e in (ACTUATOR_GAIN, WHEEL_RADIUS_MISMATCH, TRACK_WIDTH, COMMAND_DELAY, ACTUATOR_LAG, SATURATION, LATERAL_SLIP)
)
# flaws of the model, with the effects that describe a part of each: naming one of these is no error
FLAWS = {
    "servo_without_integral": tuple(
        e.name for e in (ACTUATOR_LAG, ACTUATOR_GAIN, WHEEL_RADIUS, DEAD_ZONE, SATURATION, COMMAND_DELAY)
    ),
    "scrubbing_tyres": tuple(e.name for e in (TRACK_WIDTH, LATERAL_SLIP, ACTUATOR_LAG)),
    "soft_tyres": tuple(e.name for e in (WHEEL_RADIUS, ACTUATOR_GAIN, SATURATION, LONGITUDINAL_SLIP)),
    "swivelling_castor": (),
}
BEYOND = "uneven_floor"
_WAVES, _BUMPS = 6, 0.12  # number of waves of a floor; m, their usual length over 2 pi


def caused(cause: str, rover: Rover, rng: np.random.Generator) -> Callable[[float], Rover]:
    """The rover by the strength of a cause that no library names."""
    left = float(rng.uniform(0.6, 1.0))
    blows = []
    for begin in np.arange(1.5, 24.0, 1.7):
        blow = rng.normal(size=3)
        begin = float(begin + rng.uniform(0, 0.8))
        blows.append((begin, begin + float(rng.uniform(0.3, 0.9)), *(float(b) for b in blow)))
    swings = rng.uniform((0.5, 0.3, 0.0), (2.5, 1.0, 6.0), (3, 3))  # rad/s, 1, rad
    truth, sensor = rover.truth, rover.sensor

    def of(s: float) -> Rover:
        if cause == "magnetic_heading":
            return replace(rover, sensor=replace(sensor, magnetic=(0.6 * s, 6.0 * left)))
        if cause == "drifting_gyro":
            wander = tuple((float(w), float(0.2 * s * a), float(p)) for w, a, p in swings)
            return replace(rover, sensor=replace(sensor, wander=wander))
        if cause == "relocations":
            jumps = tuple((a, 0.1 * s * x, 0.1 * s * y, 0.1 * s * w) for a, _, x, y, w in blows)
            return replace(rover, sensor=replace(sensor, relocated=jumps))
        changed = {
            "eccentric_wheel": lambda: replace(truth, eccentric=(0.5 * s, 0.5 * s * left)),
            "one_sided_turning": lambda: replace(truth, one_sided=0.6 * s),
            "warming_up": lambda: replace(truth, warm_up=0.6 * s, warm_up_time=5.0),
            "gusts": lambda: replace(
                truth, gusts=tuple((a, b, 0.4 * s * x, 0.4 * s * y, 0.8 * s * w) for a, b, x, y, w in blows)
            ),
            "flipping_castor": lambda: replace(truth, castor=0.5 * s),
            "carpet_nap": lambda: replace(truth, nap=0.5 * s, nap_heading=6.0 * left),
            "hot_motors": lambda: replace(truth, heat=0.9 * s),
        }
        return replace(rover, truth=changed[cause]())

    return of


def flawed(flaw: str, rover: Rover, rng: np.random.Generator) -> Callable[[float], tuple[Rover, Rover]]:
    """By the strength of the flaws: the rover on an uneven floor with a flaw, and without it."""
    share, time = float(rng.uniform(0.5, 1.0)), float(rng.uniform(0.06, 0.12))
    waves = rng.normal(size=(_WAVES, 2)) / _BUMPS  # 1/m
    phases, pushes = rng.uniform(0, 2 * np.pi, _WAVES), rng.normal(size=(_WAVES, 2)) * (0.1, 0.5)

    def of(s: float) -> tuple[Rover, Rover]:
        floor = tuple(
            (float(kx), float(ky), float(p), float(s * along), float(s * turning))
            for (kx, ky), p, (along, turning) in zip(waves, phases, pushes, strict=True)
        )
        plain = replace(rover.truth, floor=floor)
        changed = {
            "servo_without_integral": lambda: replace(plain, servo=0.25 * s * share, servo_time=time),
            "scrubbing_tyres": lambda: replace(plain, scrub=min(1.5 * s * share, 0.8)),
            "soft_tyres": lambda: replace(plain, soft=min(0.8 * s * share, 0.7)),
            "swivelling_castor": lambda: replace(plain, castor=0.5 * s * share),
        }
        return replace(rover, truth=changed[flaw]()), replace(rover, truth=plain)

    return of


def changing(
    draw: Draw, rover: Rover, runs: Sequence[tuple[str, float]], rng: np.random.Generator
) -> tuple[str, Callable[[float], Rover]]:
    """How the effect comes or goes, and the rover by its strength; runs: (name, s) in the order in which they were
    driven."""
    how = str(rng.choice(["begins", "ends", "differs"]))
    number = int(rng.integers(1, len(runs) - 1))
    name, since = runs[number][0], float(rng.uniform(0.3, 0.7)) * runs[number][1]
    sizes = rng.permutation(np.concatenate([[0.0, 1.0], rng.uniform(0.0, 1.0, len(runs) - 2)]))

    def at(s: float) -> Rover:
        return PLANTINGS[draw.effect].plant(rover, draw, s)[0] if s > 0.0 else rover

    def of(s: float) -> Rover:
        if how == "differs":
            by_run = {run: (0.0, at(s * size)) for (run, _), size in zip(runs, sizes, strict=True)}
            return replace(rover, changes=by_run)
        before, after = (rover, at(s)) if how == "begins" else (at(s), rover)
        later = {run: (0.0, after) for run, _ in runs[number + 1 :]}
        return replace(before, changes={name: (since, after), **later})

    words = "differs from run to run" if how == "differs" else f"{how} in {name} at {since:.1f} s"
    return words, of
