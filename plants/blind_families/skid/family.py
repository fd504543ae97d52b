"""Blind cases of a robot that skids on four wheels, of 5 g to 500 kg; its nominal model is a differential drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from plants.blind_families.case import Drawn, choose_for, first_case, make
from plants.blind_families.planting import Plantings
from plants.blind_families.skid.setting import draw_contact
from plants.blind_families.wheeled.effects import PLANTINGS as OF_ROVERS
from plants.blind_families.wheeled.effects import Draw, Place, Rover
from plants.blind_families.wheeled.family import HABITS as OF_ROVERS_HABITS
from plants.blind_families.wheeled.family import WheeledBench
from plants.blind_families.wheeled.faults import PAIRS
from residual_mpc.blind.levels import Level
from residual_mpc.blind.records import Answer
from residual_mpc.effects.actuator import ACTUATOR_GAIN, ACTUATOR_LAG, RATE_LIMIT, SATURATION, VOLTAGE_SAG
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE
from residual_mpc.effects.contact import (
    LATERAL_SLIP,
    LONGITUDINAL_SLIP,
    TRACK_WIDTH,
    WHEEL_RADIUS,
    WHEEL_RADIUS_MISMATCH,
)
from residual_mpc.effects.sensor import SENSOR_BIAS, SENSOR_DELAY, SENSOR_MOUNTING, SENSOR_OUTLIERS

# what sits in the drives, the wheels and the sensors; the contacts have laws of their own
PLANTINGS: Plantings[Rover, Draw, Place] = {
    e.name: OF_ROVERS[e.name]
    for e in (
        ACTUATOR_GAIN,
        ACTUATOR_LAG,
        COMMAND_DELAY,
        DEAD_ZONE,
        SATURATION,
        SENSOR_BIAS,
        SENSOR_DELAY,
        SENSOR_MOUNTING,
        SENSOR_OUTLIERS,
        VOLTAGE_SAG,
        WHEEL_RADIUS,
        WHEEL_RADIUS_MISMATCH,
    )
}

HABITS = replace(OF_ROVERS_HABITS, pairs=tuple(pair for pair in PAIRS if set(pair) <= set(PLANTINGS)))
# what contacts and drives do that a differential drive has names for: naming one of these is no error. The drives'
# torque is finite, so that a wheel that leaves a dead zone speeds up at a limited rate.
DESCRIBED = tuple(
    e.name for e in (LATERAL_SLIP, LONGITUDINAL_SLIP, TRACK_WIDTH, WHEEL_RADIUS, ACTUATOR_LAG, RATE_LIMIT)
)
# What the contacts leave, over the noise floor and as a gap, from which on no set of effects is the whole truth.
# Another track and a little slip close about three quarters of it.
_LEFT = 12.0, 0.15
_ATTEMPTS = 40  # draws of effects before a level is given up


class SkidFamily:
    """Robots on four wheels in contact with the ground, at the levels that need nothing but effects."""

    name = "skid_steer"
    levels = ("single", "double", "confusable")

    def write_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Answer:
        """Draw a truth and write what its user would have."""
        return self.draw_case(level, seed, rng, folder).answer

    def draw_case(self, level: Level, seed: int, rng: np.random.Generator, folder: Path) -> Drawn[Rover, Draw]:
        """As ``write_case``, with the robot."""

        def attempt() -> Drawn[Rover, Draw] | None:
            return make(self.name, _bench(level, rng), level, seed, rng, folder)

        return first_case(attempt, _ATTEMPTS, f"skid-steer case of level {level.name} with seed {seed}")


def _bench(level: Level, rng: np.random.Generator) -> WheeledBench:
    effects, _ = choose_for(PLANTINGS, HABITS, level, rng)
    contact = draw_contact(level, effects, rng)
    left = ("contacts",) if contact.rest[0] > _LEFT[0] and contact.rest[1] > _LEFT[1] else ()
    return WheeledBench(
        contact.setting, effects, False, habits=HABITS, always=left, described=DESCRIBED, rest=contact.rest[0]
    )


FAMILY = SkidFamily()
