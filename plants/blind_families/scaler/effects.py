"""The effects of serial arms that a SCALER arm has as well, and what its servos and its loop change of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from plants.blind_families.arm.effects import PLANTINGS as OF_ARMS
from plants.blind_families.arm.effects import ArmRobot, Draw, Place
from plants.blind_families.planting import Planting, Plantings, by_name
from plants.blind_families.scaler.model import FOREARM
from residual_mpc.effects.actuator import ACTUATOR_GAIN, ACTUATOR_LAG, SATURATION, VOLTAGE_SAG
from residual_mpc.effects.body import (
    ARMATURE,
    COULOMB,
    LINK_MASS,
    LOAD_FRICTION,
    PAYLOAD,
    STRIBECK,
    VISCOUS,
)
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE
from residual_mpc.effects.effect import Effect
from residual_mpc.effects.sensor import SENSOR_BIAS, SENSOR_DELAY, SENSOR_OUTLIERS

# What comes late by a little looks alike behind a servo that is damped this well: its own lag, more of its damping,
# and a rotor that is slow to start.
LATE = "late behind a servo"


def _always(joint: int | None) -> Callable[[Place], Place]:
    """The joint, whatever the arms' own draw says; it is drawn all the same."""

    def placed(drawn: Place) -> Place:
        def place(joints: int, rng: np.random.Generator) -> int | None:
            drawn(joints, rng)
            return joint

        return place

    return placed


def _as_drawn(drawn: Place) -> Place:
    return drawn


def _of_arms(
    effect: Effect, *clashes: str, place: Callable[[Place], Place] = _as_drawn
) -> Planting[ArmRobot, Draw, Place]:
    """The arms' own planting of the effect, in more groups and at another place."""
    arms = OF_ARMS[effect.name]
    return replace(arms, clashes=(*arms.clashes, *clashes), place=place(arms.place))


PLANTINGS: Plantings[ArmRobot, Draw, Place] = by_name(
    _of_arms(COMMAND_DELAY, LATE),
    _of_arms(SENSOR_DELAY, LATE),
    _of_arms(DEAD_ZONE),
    _of_arms(ACTUATOR_LAG, LATE),
    _of_arms(ACTUATOR_GAIN),
    _of_arms(SATURATION),
    _of_arms(VOLTAGE_SAG),
    _of_arms(COULOMB),
    _of_arms(VISCOUS, LATE),
    _of_arms(STRIBECK),
    _of_arms(LOAD_FRICTION),
    _of_arms(PAYLOAD),
    _of_arms(LINK_MASS, place=_always(FOREARM)),
    _of_arms(ARMATURE, LATE),
    _of_arms(SENSOR_BIAS),
    _of_arms(SENSOR_OUTLIERS, place=_always(None)),  # no candidate blames one encoder for outliers
)
