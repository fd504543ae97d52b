"""What is drawn of a skidding robot's case before any effect: its nominal model is a differential drive, calibrated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plants.blind_families.skid.truth import Skidder
from plants.blind_families.wheeled.effects import PoseSensor, Rover
from plants.blind_families.wheeled.setting import Setting, draw_setting, drive, gap
from plants.blind_families.wheeled.truth import WheeledTruth
from residual_mpc.blind.levels import Level

_APART = 0.2  # s between the poses that a calibration compares


@dataclass(frozen=True)
class Contact:
    """A setting whose rover is the calibrated model, and what the contacts leave of it: (over the noise floor, gap)."""

    setting: Setting
    rest: tuple[float, float]


def draw_contact(level: Level, effects: tuple[str, ...], rng: np.random.Generator) -> Contact:
    """A robot of any size with a log of any rate."""
    drawn = draw_setting(replace(level, wild=True), effects, False, rng)
    truth = drawn.rover.truth
    skidder = Skidder(
        truth.wheel_radius,
        truth.track_width,
        truth.track_width * float(rng.uniform(0.6, 1.1)),
        float(rng.uniform(0.5, 1.0)),
    )
    drawn = replace(drawn, simulate=skidder.simulate, feedback=False, plans=drawn.plans[:3] + drawn.plans[4:])
    wheel_radius, track_width = _calibrated(drawn)
    known = WheeledTruth(wheel_radius, track_width, truth.speed_scale)
    setting = replace(drawn, rover=Rover(known, PoseSensor()))
    return Contact(setting, gap(setting.rover, setting))


def _calibrated(setting: Setting) -> tuple[float, float]:
    """(wheel radius, track width) m that describe the robot's runs best, over short stretches."""
    truth = setting.rover.truth
    gone, rolled, turned, against = [], [], [], []
    for plan in setting.plans:
        happened = drive(setting.rover, setting, plan, (0.0, 0.0))
        t = np.arange(0.0, plan.t[-1], _APART)
        pose = happened.pose(t)
        angle = np.concatenate([[[0.0, 0.0]], np.cumsum(happened.motor[1:] * np.diff(happened.t)[:, None], axis=0)])
        wheel = np.stack([np.interp(t, happened.t, angle[:, i]) for i in (0, 1)], axis=1)
        middle = 0.5 * (pose[1:, 2] + pose[:-1, 2])
        step, rotation = np.diff(pose, axis=0), np.diff(wheel, axis=0)
        gone.append(step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle))
        rolled.append(rotation.mean(axis=1))
        turned.append(step[:, 2])
        against.append(rotation[:, 1] - rotation[:, 0])
    distance, roll, turn, twist = (np.concatenate(v) for v in (gone, rolled, turned, against))
    radius = float(distance @ roll / (roll @ roll)) if roll @ roll > 0 else truth.wheel_radius
    return radius, radius * float(twist @ twist / (turn @ twist))
