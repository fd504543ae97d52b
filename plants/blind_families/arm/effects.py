"""From a library effect and a strength to the truth that has it, for an arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm.truth import ArmTruth

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArmSensor:
    """The encoders as they really are, (n,) each."""

    delay: Array  # s
    bias: Array  # rad
    outliers: Array  # share of the samples


@dataclass(frozen=True)
class ArmRobot:
    """Truth and sensors of one case, and what the joints are used to (for scales only)."""

    truth: ArmTruth
    sensor: ArmSensor
    torque: Array  # (n,) N m, largest nominal torque
    torque_rms: Array  # (n,) N m
    speed_rms: Array  # (n,) rad/s
    inertia: Array  # (n,) kg m^2
    command: Array  # (n,) largest command, in its unit


@dataclass(frozen=True)
class Draw:
    """What is drawn once for an effect; the strength alone is then tuned."""

    effect: str
    joint: int | None  # None: all alike
    sign: float
    shape: float  # 0 to 1, for a second parameter


def _put(robot: ArmRobot, draw: Draw, field: str, value: Array | float) -> ArmTruth:
    """The truth with ``value`` at the drawn joint, or at all of them."""
    old = np.array(getattr(robot.truth, field), dtype=float)
    where = slice(None) if draw.joint is None else draw.joint
    old[where] = np.broadcast_to(value, old.shape)[where]
    changes: dict[str, Any] = {field: old}
    return replace(robot.truth, **changes)


def _joint(field: str, parameter: str, law: Callable[[float, Draw, ArmRobot, int], float]) -> Any:
    """An effect with one constant at one joint; where it is at all of them, the constant is the same one."""

    def plant(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
        value = law(s, draw, robot, 0 if draw.joint is None else draw.joint)
        return replace(robot, truth=_put(robot, draw, field, value)), {parameter: value}

    return plant


def _sag(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    scale = np.maximum(robot.torque_rms * 0.8, 1e-6)
    return replace(robot, truth=replace(robot.truth, sag=0.04 * s, torque_scale=scale)), {"rate": 0.04 * s}


def _coulomb(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    value = s * robot.torque_rms[draw.joint or 0]
    truth = _put(replace(robot, truth=_put(robot, draw, "static", value)), draw, "kinetic", value)
    return replace(robot, truth=truth), {"torque": float(value)}


def _stribeck(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    static = s * 1.3 * robot.torque_rms[draw.joint or 0]
    kinetic, velocity = static * (0.3 + 0.3 * draw.shape), 0.05 + 0.2 * draw.shape
    truth = _put(replace(robot, truth=_put(robot, draw, "static", static)), draw, "kinetic", kinetic)
    truth = _put(replace(robot, truth=truth), draw, "stribeck", velocity)
    return replace(robot, truth=truth), {
        "static": float(static),
        "kinetic": float(kinetic),
        "velocity": velocity,
    }


def _payload(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    mass = float(s * robot.truth.arm.mass.sum())
    return replace(robot, truth=replace(robot.truth, payload=mass)), {"mass": mass}


def _link_mass(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    arm, j = robot.truth.arm, draw.joint or 0
    mass = float(s * 1.5 * arm.mass[j])
    com = float(draw.sign * s * 0.4 * draw.shape * arm.length[j])
    truth = _put(replace(robot, truth=_put(robot, draw, "link_mass", mass)), draw, "link_com", com)
    return replace(robot, truth=truth), {"mass": mass, "com": com}


def _compliance(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    """At full strength the link swings at about 8 rad/s on the spring."""
    j = draw.joint or 0
    stiffness = float(60.0 * robot.inertia[j] / s)
    usual = max(float(robot.torque_rms[j]) / stiffness, 1e-3)
    truth = _put(replace(robot, truth=_put(robot, draw, "stiffness", stiffness)), draw, "wound", usual)
    return replace(robot, truth=truth), {"stiffness": stiffness}


def _sensor(field: str, parameter: str, law: Callable[[float, Draw], float]) -> Any:
    def plant(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
        values = np.array(getattr(robot.sensor, field), dtype=float)
        values[slice(None) if draw.joint is None else draw.joint] = law(s, draw)
        changes: dict[str, Any] = {field: values}
        return replace(robot, sensor=replace(robot.sensor, **changes)), {parameter: law(s, draw)}

    return plant


def _width(s: float, draw: Draw, robot: ArmRobot, j: int) -> float:
    return float(0.15 * s if robot.truth.arm.kind == "position" else s * 0.6 * robot.command[j])


Plant = Callable[[ArmRobot, Draw, float], tuple[ArmRobot, dict[str, float]]]
PLANT: dict[str, Plant] = {
    "command_delay": _joint("delay", "delay", lambda s, d, r, j: 0.15 * s),
    "dead_zone": _joint("dead_zone", "width", _width),
    "actuator_lag": _joint("lag", "time_constant", lambda s, d, r, j: 0.3 * s),
    "actuator_gain": _joint("gain", "gain", lambda s, d, r, j: 1 + (0.8 if d.sign > 0 else -0.7) * s),
    "saturation": _joint("limit", "limit", lambda s, d, r, j: float(r.torque[j] * (1 - 0.85 * s))),
    "voltage_sag": _sag,
    "coulomb_friction": _coulomb,
    "viscous_friction": _joint(
        "viscous", "coefficient", lambda s, d, r, j: float(s * 2 * r.torque_rms[j] / r.speed_rms[j])
    ),
    "stribeck_friction": _stribeck,
    "load_dependent_friction": _joint("load", "coefficient", lambda s, d, r, j: 0.8 * s),
    "payload": _payload,
    "link_mass": _link_mass,
    "armature": _joint("armature", "inertia", lambda s, d, r, j: float(3 * s * r.inertia[j])),
    "sensor_delay": _sensor("delay", "delay", lambda s, d: 0.15 * s),
    "sensor_bias": _sensor("bias", "bias", lambda s, d: d.sign * 0.3 * s),
    "sensor_outliers": _sensor("outliers", "rate", lambda s, d: 0.06 * s),
}
# effects of serial arms alone
SERIAL: dict[str, Plant] = PLANT | {
    "backlash": _joint("play", "gap", lambda s, d, r, j: 0.2 * s),
    "joint_compliance": _compliance,
    "link_length": _joint("longer", "offset", lambda s, d, r, j: float(0.8 * d.sign * s * r.truth.arm.length[j])),
}
# share of full strength that is typical of a strong case: a tenth of it is a faint background
TYPICAL = dict.fromkeys(SERIAL, 0.2) | {"voltage_sag": 0.3, "payload": 0.1, "link_mass": 0.3}
_WHOLE = ("voltage_sag", "payload")  # effects of the robot
_OFTEN_ALL = ("command_delay", "sensor_delay", "actuator_lag", "sensor_outliers")


def draw_effect(effect: str, joints: int, rng: np.random.Generator) -> Draw:
    """Joint, sign and shape of ``effect``."""
    joint: int | None = int(rng.integers(joints - 1 if effect == "link_length" else joints))
    if effect in _WHOLE or (effect in _OFTEN_ALL and rng.random() < 0.7):
        joint = None
    return Draw(effect, joint, float(rng.choice([-1, 1])), float(rng.random()))


def target_of(draw: Draw) -> str | None:
    """The name the contract gives to where the effect sits."""
    if draw.joint is None:
        return None
    number = draw.joint + 1
    if draw.effect in ("link_mass", "link_length"):
        return f"link{number}"
    if draw.effect in ("sensor_delay", "sensor_bias", "sensor_outliers"):
        return f"position.j{number}"
    return f"j{number}"
