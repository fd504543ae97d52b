"""From a library effect and a strength to the truth that has it, for an arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm.truth import ArmTruth
from plants.blind_families.planting import Confounded, Faint, Planting, Plantings, by_name
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
from residual_mpc.effects.library import BY_NAME
from residual_mpc.effects.sensor import CLOCK_SKEW, SENSOR_BIAS, SENSOR_DELAY, SENSOR_OUTLIERS

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArmSensor:
    """The encoders as they really are, (n,) each."""

    delay: Array  # s
    bias: Array  # rad
    outliers: Array  # share of the samples
    skew: float = 0.0  # s that their clock gains in a second
    off_axis: Array | float = 0.0  # (n,) offset of an encoder's disc from its axis, over the disc's radius
    towards: float = 0.0  # rad, where the disc is off
    crossed: float = 0.0  # share of the joint before in the reading of a joint: a cause that no library names
    scale: Array | float = 1.0  # (n,) readings over the truth
    lag: Array | float = 0.0  # (n,) s by which the readings' filter lags


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
    highest: Array  # (n,) rad, to which the reference motion goes
    lowest: Array  # (n,) rad
    changes: tuple[tuple[float, ArmTruth], ...] = ()  # by run: from when on (s) it is another

    def at(self, run: int) -> tuple[ArmTruth, tuple[float, ArmTruth] | None]:
        """The truth at the start of a run, and what becomes of it in the middle, if anything."""
        if not self.changes:
            return self.truth, None
        since, other = self.changes[run]
        return (other, None) if since <= 0.0 else (self.truth, (since, other))


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
    """At full strength the link swings at about 8 rad/s on the spring, damped at 1 to 20 % of critical."""
    j = draw.joint or 0
    stiffness = float(60.0 * robot.inertia[j] / s)
    usual = max(float(robot.torque_rms[j]) / stiffness, 1e-3)
    ratio = float(0.01 * 20.0**draw.shape)
    for field, value in (("stiffness", stiffness), ("wound", usual), ("ringing", ratio)):
        robot = replace(robot, truth=_put(robot, draw, field, value))
    return robot, {"stiffness": stiffness, "damping_ratio": ratio}


def _sensor(field: str, parameter: str, law: Callable[[float, Draw], float]) -> Any:
    def plant(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
        values = np.array(getattr(robot.sensor, field), dtype=float)
        values[slice(None) if draw.joint is None else draw.joint] = law(s, draw)
        changes: dict[str, Any] = {field: values}
        return replace(robot, sensor=replace(robot.sensor, **changes)), {parameter: law(s, draw)}

    return plant


def _skew(robot: ArmRobot, draw: Draw, s: float) -> tuple[ArmRobot, dict[str, float]]:
    rate = draw.sign * 0.01 * s
    return replace(robot, sensor=replace(robot.sensor, skew=rate)), {"rate": rate}


def _width(s: float, draw: Draw, robot: ArmRobot, j: int) -> float:
    return float(0.15 * s if robot.truth.arm.kind == "position" else s * 0.6 * robot.command[j])


def one_joint(joints: int, rng: np.random.Generator) -> int | None:
    return int(rng.integers(joints))


def _inner(joints: int, rng: np.random.Generator) -> int | None:
    """A joint with another one behind it."""
    return int(rng.integers(joints - 1))


def every_joint(joints: int, rng: np.random.Generator) -> int | None:
    rng.integers(joints)  # the numbers behind it stay those of an effect that sits at one joint
    return None


def _often_all(joints: int, rng: np.random.Generator) -> int | None:
    joint = int(rng.integers(joints))
    return None if rng.random() < 0.7 else joint


Place = Callable[[int, np.random.Generator], int | None]  # number of joints -> joint; None: all alike
# groups of which a case holds one member at most
DELAYS, FRICTIONS, INERTIAS, WEIGHTS = "delays", "dry frictions", "inertias", "weights and levers"
GEARS, OUTPUTS = "play and springs", "output"

PLANTINGS: Plantings[ArmRobot, Draw, Place] = by_name(
    Planting(
        COMMAND_DELAY,
        _joint("delay", "delay", lambda s, d, r, j: 0.15 * s),
        _often_all,
        typical=0.2,
        clashes=(DELAYS,),
        confounded=Confounded(),
    ),
    Planting(
        SENSOR_DELAY,
        _sensor("delay", "delay", lambda s, d: 0.15 * s),
        _often_all,
        typical=0.2,
        clashes=(DELAYS,),
        confounded=Confounded(),
    ),
    Planting(DEAD_ZONE, _joint("dead_zone", "width", _width), one_joint, typical=0.2),
    Planting(
        ACTUATOR_LAG,
        _joint("lag", "time_constant", lambda s, d, r, j: 0.3 * s),
        _often_all,
        typical=0.2,
        clashes=(DELAYS,),
    ),
    Planting(
        ACTUATOR_GAIN,
        _joint("gain", "gain", lambda s, d, r, j: 1 + (0.8 if d.sign > 0 else -0.7) * s),
        one_joint,
        typical=0.2,
        clashes=(OUTPUTS,),
    ),
    Planting(
        SATURATION,
        _joint("limit", "limit", lambda s, d, r, j: float(r.torque[j] * (1 - 0.85 * s))),
        one_joint,
        typical=0.2,
        clashes=(OUTPUTS,),
        faint=Faint.NONE,
    ),
    Planting(VOLTAGE_SAG, _sag, every_joint, typical=0.3, clashes=(OUTPUTS,)),
    Planting(COULOMB, _coulomb, one_joint, typical=0.2, clashes=(FRICTIONS,), faint=Faint.NO_CLASH),
    Planting(
        VISCOUS,
        _joint("viscous", "coefficient", lambda s, d, r, j: float(s * 2 * r.torque_rms[j] / r.speed_rms[j])),
        one_joint,
        typical=0.2,
    ),
    Planting(STRIBECK, _stribeck, one_joint, typical=0.2, clashes=(FRICTIONS,), faint=Faint.NONE),
    Planting(
        LOAD_FRICTION,
        _joint("load", "coefficient", lambda s, d, r, j: 0.8 * s),
        one_joint,
        typical=0.2,
        clashes=(FRICTIONS,),
        faint=Faint.NO_CLASH,
    ),
    Planting(PAYLOAD, _payload, every_joint, typical=0.1, clashes=(INERTIAS, WEIGHTS)),
    Planting(LINK_MASS, _link_mass, one_joint, typical=0.3, clashes=(INERTIAS, WEIGHTS)),
    Planting(
        ARMATURE,
        _joint("armature", "inertia", lambda s, d, r, j: float(3 * s * r.inertia[j])),
        one_joint,
        typical=0.2,
        clashes=(INERTIAS,),
    ),
    Planting(SENSOR_BIAS, _sensor("bias", "bias", lambda s, d: d.sign * 0.3 * s), one_joint, typical=0.2),
    Planting(
        SENSOR_OUTLIERS,
        _sensor("outliers", "rate", lambda s, d: 0.06 * s),
        _often_all,
        typical=0.2,
        faint=Faint.NONE,
        tuned=False,
    ),
    Planting(
        BACKLASH,
        _joint("play", "gap", lambda s, d, r, j: 0.2 * s),
        one_joint,
        typical=0.2,
        clashes=(GEARS,),
        faint=Faint.NONE,
    ),
    Planting(JOINT_COMPLIANCE, _compliance, one_joint, typical=0.2, clashes=(GEARS,), faint=Faint.NONE),
    Planting(
        LINK_LENGTH,
        _joint("longer", "offset", lambda s, d, r, j: float(0.8 * d.sign * s * r.truth.arm.length[j])),
        _inner,
        typical=0.2,
        clashes=(WEIGHTS,),
        faint=Faint.NONE,
    ),
)


# what takes a long run to show; drawn at a level of its own, so that the cases of the others stay
LONG_PLANTINGS: Plantings[ArmRobot, Draw, Place] = by_name(Planting(CLOCK_SKEW, _skew, every_joint, typical=0.2))


def draw_effect(
    effect: str, joints: int, rng: np.random.Generator, plantings: Plantings[ArmRobot, Draw, Place] = PLANTINGS
) -> Draw:
    """Joint, sign and shape of ``effect``."""
    joint = plantings[effect].place(joints, rng)
    return Draw(effect, joint, float(rng.choice([-1, 1])), float(rng.random()))


def target_of(draw: Draw, joints: Sequence[str], links: Sequence[str]) -> str | None:
    """The name the contract gives to where the effect sits; links: those that the joints carry."""
    if draw.joint is None:
        return None
    effect = BY_NAME[draw.effect]
    if effect.target == "body":
        return links[draw.joint]
    return f"position.{joints[draw.joint]}" if effect.stage == "sensor" else joints[draw.joint]
