"""What goes wrong with an arm besides constant effects: causes without a name, flaws of its model, effects that come
and go; and which effects are easily mistaken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from plants.blind_families.arm.effects import PLANTINGS, ArmRobot, Draw
from plants.blind_families.arm.flaws import ArmFlaws
from plants.blind_families.arm.truth import ArmTruth
from residual_mpc.effects.actuator import ACTUATOR_GAIN, ACTUATOR_LAG, BACKLASH, SATURATION, VOLTAGE_SAG
from residual_mpc.effects.body import (
    ARMATURE,
    COULOMB,
    JOINT_COMPLIANCE,
    LINK_LENGTH,
    LINK_MASS,
    LOAD_FRICTION,
    PAYLOAD,
    STRIBECK,
    VISCOUS,
)
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE

UNNAMED = ("dented_tooth", "dragging_cable", "warming_friction", "gusts")
UNNAMED_IN_TESTS = ("uneven_friction", "belt_between_joints", "crossed_encoders", "shared_supply")
PAIRS: tuple[tuple[str, str], ...] = tuple(
    (a.name, b.name)
    for a, b in (
        (COMMAND_DELAY, ACTUATOR_LAG),
        (ACTUATOR_GAIN, VOLTAGE_SAG),
        (PAYLOAD, ARMATURE),
        (JOINT_COMPLIANCE, BACKLASH),
    )
)
# what another load, grease, a worn motor do in the middle of a day; where bodies change, between runs alone
CHANGING = tuple(e.name for e in (ACTUATOR_GAIN, COULOMB, VISCOUS, SATURATION, DEAD_ZONE, PAYLOAD))
_BETWEEN_RUNS = (PAYLOAD.name,)
_NEVER = 1e6  # s
_WEIGHTS = tuple(e.name for e in (LINK_LENGTH, LINK_MASS, PAYLOAD))
_FRICTIONS = tuple(e.name for e in (COULOMB, VISCOUS, STRIBECK, LOAD_FRICTION))
# flaws of the model, with the effects that describe a part of each: naming one of these is no error
FLAWS = {
    "links_that_bend": (JOINT_COMPLIANCE.name, ARMATURE.name, *_WEIGHTS),
    "axes_out_of_true": _WEIGHTS,
    "friction_by_the_root": _FRICTIONS,
    "soft_servos": (ACTUATOR_GAIN.name, SATURATION.name, ACTUATOR_LAG.name, VISCOUS.name),
}
BEYOND = "tugging_hose"


def caused(cause: str, robot: ArmRobot, seconds: float, rng: np.random.Generator) -> Callable[[float], ArmRobot]:
    """The arm by the strength of a cause that no library names; seconds: of the runs."""
    truth, torque = robot.truth, robot.torque_rms
    n = len(torque)
    one = np.zeros(n)
    one[rng.integers(n)] = 1.0
    dented = truth.arm.home + 0.02 * (int(rng.integers(9, 26)) - 17)
    blows = []
    for begin in np.arange(1.5, seconds - 1.0, 1.6):
        begin = float(begin + rng.uniform(0, 0.8))
        blows.append([begin, begin + float(rng.uniform(0.2, 0.7)), *(rng.normal(size=n) * torque)])

    def of(s: float) -> ArmRobot:
        if cause == "crossed_encoders":
            return replace(robot, sensor=replace(robot.sensor, crossed=0.3 * s))
        gusts = np.array(blows)
        gusts[:, 2:] *= 2.0 * s
        between = 2.0 * s * torque[:-1] / robot.speed_rms[:-1]
        changes: dict[str, dict[str, Any]] = {
            "dented_tooth": {"dent": 4.0 * s * torque * one, "dented": dented},
            "dragging_cable": {"cable": 6.0 * s * torque * one},
            "warming_friction": {"warm_up": 3.0 * s * torque * one},
            "gusts": {"gusts": gusts},
            "uneven_friction": {"flaws": ArmFlaws(uneven=2.0 * s * torque * one)},
            "belt_between_joints": {"flaws": ArmFlaws(belt=between)},
            "shared_supply": {"flaws": ArmFlaws(supply=1.5 * s, usual=np.maximum(torque, 1e-9))},
        }
        return replace(robot, truth=replace(truth, **changes[cause]))

    return of


def flawed(
    flaw: str, robot: ArmRobot, seconds: float, rng: np.random.Generator
) -> Callable[[float], tuple[ArmRobot, ArmRobot]]:
    """By the strength of the flaws: the arm with a hose that tugs at it and a flaw, and without the flaw; seconds: of
    the runs."""
    share, sign = float(rng.uniform(0.5, 1.0)), float(rng.choice([-1, 1]))
    usual = np.maximum(robot.torque_rms, 1e-9)
    tugs = []
    for begin in np.arange(0.8, seconds - 1.0, 0.9):
        begin = float(begin + rng.uniform(0, 0.6))
        tugs.append([begin, begin + float(rng.uniform(0.3, 1.2)), *(rng.normal(size=len(usual)) * usual)])

    def of(s: float) -> tuple[ArmRobot, ArmRobot]:
        hose = np.array(tugs)
        hose[:, 2:] *= 2.0 * s
        plain = replace(robot.truth, gusts=hose)
        flaws = {
            "links_that_bend": lambda: ArmFlaws(flex=15.0 / np.sqrt(s * share)),
            "axes_out_of_true": lambda: ArmFlaws(tilt=0.5 * sign * s * share),
            "friction_by_the_root": lambda: ArmFlaws(rooted=1.5 * s * share * robot.torque_rms),
            "soft_servos": lambda: ArmFlaws(soft=1.2 * min(s, 0.8) * share, usual=usual),
        }
        return replace(robot, truth=replace(plain, flaws=flaws[flaw]())), replace(robot, truth=plain)

    return of


def changing(
    draw: Draw, robot: ArmRobot, runs: int, seconds: float, rng: np.random.Generator
) -> tuple[str, Callable[[float], ArmRobot]]:
    """How the effect comes or goes, and the arm by its strength; runs of so many seconds."""
    between = draw.effect in _BETWEEN_RUNS
    how = "differs" if between else str(rng.choice(["begins", "ends", "differs"]))
    number = int(rng.integers(1, runs - 1))
    since = float(rng.uniform(0.3, 0.7)) * seconds
    sizes = rng.permutation(np.concatenate([[0.0, 1.0], rng.uniform(0.0, 1.0, runs - 2)]))

    def at(s: float) -> ArmTruth:
        return PLANTINGS[draw.effect].plant(robot, draw, s)[0].truth if s > 0.0 else robot.truth

    def of(s: float) -> ArmRobot:
        if how == "differs":
            return replace(robot, changes=tuple((0.0, at(s * float(size))) for size in sizes))
        before, after = (robot.truth, at(s)) if how == "begins" else (at(s), robot.truth)
        starts = [_NEVER if r < number else since if r == number else 0.0 for r in range(runs)]
        return replace(robot, truth=before, changes=tuple((float(start), after) for start in starts))

    words = "differs from run to run" if how == "differs" else f"{how} in run{number + 1} at {since:.1f} s"
    return words, of
