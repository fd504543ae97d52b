"""Augmented differential drives for the tests: every effect that a step can have, and a network."""

from __future__ import annotations

import math

import numpy as np

from plants.diff_drive import DiffDrive
from residual_mpc.export.augmented import Augmented, Build, augment
from residual_mpc.learning.forms.body import BODY, WORLD
from residual_mpc.learning.network.mlp import Mlp
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Knob

ROBOT = DiffDrive("rover", 0.033, 0.16)
DT = 0.05  # s

EFFECTS: dict[str, dict[Knob, float]] = {
    "none": {},
    "command_delay": {Knob("command_delay", None, "delay"): 0.08},
    "one_sided_delay": {Knob("command_delay", "left", "delay"): 0.13},
    "dead_zone": {Knob("dead_zone", None, "width"): 2.0},
    "breakaway_loss": {Knob("breakaway_loss", None, "loss"): 0.8},
    "actuator_lag": {Knob("actuator_lag", None, "time_constant"): 0.1},
    "actuator_gain": {Knob("actuator_gain", "right", "gain"): 0.9},
    "saturation": {Knob("saturation", "left", "limit"): 6.0},
    "voltage_sag": {Knob("voltage_sag", None, "rate"): 0.02},
    "backlash": {Knob("backlash", None, "gap"): 0.2},
    "turn_gain": {Knob("turn_gain", None, "gain"): 0.7},
    "turn_limit": {Knob("turn_limit", None, "limit"): 2.0},
    "shared_limit": {Knob("shared_limit", None, "limit"): 5.0},
    "forward_rate_limit": {Knob("forward_rate_limit", None, "rate"): 25.0},
    "turn_rate_limit": {Knob("turn_rate_limit", None, "rate"): 20.0},
    "wheel_radius": {Knob("wheel_radius", None, "scale"): 0.9},
    "wheel_radius_mismatch": {Knob("wheel_radius_mismatch", None, "ratio"): 1.05},
    "track_width": {Knob("track_width", None, "scale"): 1.3},
    "lateral_slip": {Knob("lateral_slip", None, "coefficient"): 0.2},
    "longitudinal_slip": {Knob("longitudinal_slip", None, "coefficient"): 0.5},
    "wheel_eccentricity": {
        Knob("wheel_eccentricity", "left", "amplitude"): 0.1,
        Knob("wheel_eccentricity", "left", "phase"): 0.4,
    },
    "slope": {Knob("slope", None, "rate"): 0.03, Knob("slope", None, "heading"): 0.7},
}
TOGETHER = {k: v for effects in EFFECTS.values() for k, v in effects.items() if k.target is None}


def learned(form: str = "body", size: float = 1.0, limit: float = math.inf) -> Residual:
    """A network with weights that matter: a few cm/s and tenths of rad/s. Its inputs' scales are those of brisk
    driving, so that a limit of 0.5 is passed all the time.
    """
    rng = np.random.default_rng(3)
    net = Mlp(5)
    names, last = (BODY, "previous") if form == "body" else (WORLD, "model")
    return Residual(
        net=net,
        theta=0.4 * rng.standard_normal(net.size),
        inputs=(*(f"{last}.{n}" for n in names), "command.left", "command.right"),
        outputs=names,
        input_mean=np.zeros(5),
        input_scale=np.array([0.3, 0.1, 2.0, 10.0, 10.0]),
        output_scale=size * np.array([0.02, 0.01, 0.2]),
        form=form,
        step=DT,
        robot="rover",
        limit=limit,
    )


def model(name: str, residual: Residual | None = None, **build: object) -> Augmented:
    level = {k: v for k, v in TOGETHER.items() if k.effect != "slope"}
    effects = {"together": TOGETHER, "without_slope": level, **EFFECTS}[name]
    return augment(ROBOT, effects, residual, Build(DT, **build))  # type: ignore[arg-type]
