"""From an effect of servos, springs, stops, mountings and encoders to the truth that has it, for an arm."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from plants.blind_families.arm.effects import ArmRobot, Draw, Place, every_joint, one_joint
from plants.blind_families.planting import Planting, Plantings, by_name
from residual_mpc.effects.actuator import RATE_LIMIT, TORQUE_SPEED_LIMIT
from residual_mpc.effects.body import GEAR_EFFICIENCY, PAYLOAD
from residual_mpc.effects.position_servo import POSITION_GAIN, SERVO_INTEGRAL
from residual_mpc.effects.sensor import ENCODER_ECCENTRICITY, SENSOR_LAG, SENSOR_SCALE
from residual_mpc.effects.surroundings import BASE_TILT, END_STOP, JOINT_SPRING, TORQUE_OFFSET, TORQUE_RIPPLE

Made = tuple[ArmRobot, dict[str, float]]
POSITION_SERVOS = "position servos"
_STIFF_STOP = 4000.0  # rad^2/s^2: a stop's torque at its usual depth, in units of the inertia, per rad


def _at_one(robot: ArmRobot, draw: Draw, **values: tuple[float, float]) -> ArmRobot:
    """The robot with constants (what does nothing, value) at the drawn joint."""
    n = len(robot.truth.arm.joints)
    fields: dict[str, Any] = {name: np.full(n, null) for name, (null, _) in values.items()}
    for name, (_, value) in values.items():
        fields[name][draw.joint] = value
    return replace(robot, truth=replace(robot.truth, beside=replace(robot.truth.beside, **fields)))


def _rate(robot: ArmRobot, draw: Draw, s: float) -> Made:
    j = draw.joint or 0
    fast = 4.0 * robot.speed_rms[j] if robot.truth.arm.kind == "position" else 40.0 * robot.command[j]
    rate = float(fast * (1.0 - 0.95 * s))
    return _at_one(robot, draw, ramp=(np.inf, rate)), {"rate": rate}


def _line(robot: ArmRobot, draw: Draw, s: float) -> Made:
    j = draw.joint or 0
    stall, free = float(robot.torque[j] * (1.4 - 0.8 * s)), float(robot.speed_rms[j] * (5.0 - 4.2 * s))
    made = _at_one(robot, draw, stall=(np.inf, stall), no_load=(1.0, free))
    return made, {"stall_torque": stall, "no_load_speed": free}


def _integral(robot: ArmRobot, draw: Draw, s: float) -> Made:
    gain = 8.0 * s
    return _at_one(robot, draw, integral=(0.0, gain)), {"gain": gain}


def _stiffness(robot: ArmRobot, draw: Draw, s: float) -> Made:
    gain = 1.0 + (1.5 if draw.sign > 0 else -0.8) * s
    return _at_one(robot, draw, stiffer=(1.0, gain)), {"gain": gain}


def _gear(robot: ArmRobot, draw: Draw, s: float) -> Made:
    j = draw.joint or 0
    forward, backward = 1.0 - 0.7 * s, 1.0 - 0.7 * s * (0.2 + 0.5 * draw.shape)
    power = np.maximum(robot.torque_rms * robot.speed_rms, 1e-9)
    made = _at_one(robot, draw, forward=(1.0, forward), backward=(1.0, backward), power=(1.0, float(power[j])))
    return made, {"forward": forward, "backward": backward}


def _spring(robot: ArmRobot, draw: Draw, s: float) -> Made:
    j = draw.joint or 0
    stiffness = float(6.0 * s * robot.torque_rms[j])
    rest = float(robot.truth.arm.home[j] + draw.sign * draw.shape)
    return _at_one(robot, draw, spring=(0.0, stiffness), rest=(0.0, rest)), {"stiffness": stiffness, "rest": rest}


def _offset(robot: ArmRobot, draw: Draw, s: float) -> Made:
    torque = float(draw.sign * 2.0 * s * robot.torque_rms[draw.joint or 0])
    return _at_one(robot, draw, offset=(0.0, torque)), {"torque": torque}


def _ripple(robot: ArmRobot, draw: Draw, s: float) -> Made:
    """Of 5 to 25 cycles per turn, not necessarily a whole number: a period of 0.25 to 1.26 rad."""
    numbers = {
        "amplitude": float(4.0 * s * robot.torque_rms[draw.joint or 0]),
        "cycles": 5.0 + 20.0 * draw.shape,
        "phase": float(draw.sign * np.pi * (17.3 * draw.shape % 1.0)),
    }
    fields = {"ripple": (0.0, numbers["amplitude"]), "cycles": (1.0, numbers["cycles"])}
    return _at_one(robot, draw, **fields, phase=(0.0, numbers["phase"])), numbers


def _stop(robot: ArmRobot, draw: Draw, s: float) -> Made:
    """At full strength in the middle of the motion, between it and the end that the sign names."""
    j = draw.joint or 0
    ends = robot.highest if draw.sign > 0 else robot.lowest
    home = robot.truth.arm.home[j]
    at = float(home + (ends[j] - home) * (1.05 - 0.9 * s))
    hard = float(_STIFF_STOP * robot.inertia[j] * 0.01)
    truth = _at_one(robot, draw, stop=(np.inf, at), hard=(1.0, hard)).truth
    return replace(robot, truth=replace(truth, beside=replace(truth.beside, side=draw.sign))), {"position": at}


def _tilt(robot: ArmRobot, draw: Draw, s: float) -> Made:
    angle = 2.0 * np.pi * draw.shape
    roll, pitch = float(0.3 * s * np.cos(angle)), float(0.3 * s * np.sin(angle))
    truth = replace(robot.truth, beside=replace(robot.truth.beside, tilt=(roll, pitch)))
    return replace(robot, truth=truth), {"roll": roll, "pitch": pitch}


def _long_tool(robot: ArmRobot, draw: Draw, s: float) -> Made:
    """A load that is centred 30 to 80 % of the last link's length beyond the tool."""
    mass = float(s * robot.truth.arm.mass.sum())
    ahead = float(robot.truth.arm.length[-1] * (0.3 + 0.5 * draw.shape))
    return replace(robot, truth=replace(robot.truth, payload=mass, ahead=ahead)), {"mass": mass, "x": ahead}


def _scale(robot: ArmRobot, draw: Draw, s: float) -> Made:
    scale = 1.0 + draw.sign * 0.2 * s
    return _reading(robot, draw, "scale", 1.0, scale), {"scale": scale}


def _eccentric(robot: ArmRobot, draw: Draw, s: float) -> Made:
    amplitude, phase = 0.25 * s, float(draw.sign * np.pi * draw.shape)
    made = _reading(robot, draw, "off_axis", 0.0, amplitude)
    return replace(made, sensor=replace(made.sensor, towards=phase)), {"amplitude": amplitude, "phase": phase}


def _slow_sensor(robot: ArmRobot, draw: Draw, s: float) -> Made:
    lag = 0.15 * s
    return _reading(robot, draw, "lag", 0.0, lag), {"time_constant": lag}


def _reading(robot: ArmRobot, draw: Draw, field: str, null: float, value: float) -> ArmRobot:
    """The robot whose encoder at the drawn joint, or each of them, has this constant."""
    values = np.full(len(robot.truth.arm.joints), null)
    values[slice(None) if draw.joint is None else draw.joint] = value
    fields: dict[str, Any] = {field: values}
    return replace(robot, sensor=replace(robot.sensor, **fields))


SERVO_PLANTINGS: Plantings[ArmRobot, Draw, Place] = by_name(
    Planting(RATE_LIMIT, _rate, one_joint, typical=0.6),
    Planting(TORQUE_SPEED_LIMIT, _line, one_joint, typical=0.5),
    Planting(SERVO_INTEGRAL, _integral, one_joint, typical=0.3, needs=(POSITION_SERVOS,)),
    Planting(GEAR_EFFICIENCY, _gear, one_joint, typical=0.3),
    Planting(JOINT_SPRING, _spring, one_joint, typical=0.2),
    Planting(TORQUE_OFFSET, _offset, one_joint, typical=0.2),
    Planting(TORQUE_RIPPLE, _ripple, one_joint, typical=0.2),
    Planting(END_STOP, _stop, one_joint, typical=0.4),
    Planting(BASE_TILT, _tilt, every_joint, typical=0.3),
    Planting(PAYLOAD, _long_tool, every_joint, typical=0.1),
    Planting(SENSOR_SCALE, _scale, one_joint, typical=0.2),
    Planting(SENSOR_LAG, _slow_sensor, every_joint, typical=0.2),
    Planting(ENCODER_ECCENTRICITY, _eccentric, one_joint, typical=0.2),
    Planting(POSITION_GAIN, _stiffness, one_joint, typical=0.2, needs=(POSITION_SERVOS,)),
)
