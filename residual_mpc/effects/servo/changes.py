"""What the owner of a servo can change about an effect: a setting, and a clause that says how."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from residual_mpc.effects.actuator import (
    ACTUATOR_GAIN,
    ACTUATOR_LAG,
    RATE_LIMIT,
    SATURATION,
    TORQUE_SPEED_LIMIT,
    VOLTAGE_SAG,
)
from residual_mpc.effects.command import COMMAND_DELAY, DEAD_ZONE
from residual_mpc.effects.position_servo import POSITION_GAIN, SERVO_INTEGRAL
from residual_mpc.effects.sensor import SENSOR_BIAS

REACHED = (1.0 / 3.0, 3.0)  # factors on a P gain within which its register is worth changing

Numbers = Mapping[str, float]  # of an effect's parameters


@dataclass(frozen=True)
class Advice:
    """One setting. register: key in the names that a manufacturer gives to its registers. text: a sentence, numbers in
    braces; numbers: those that are not parameters of the effect, with their units."""

    setting: str
    register: str
    text: str
    numbers: Mapping[str, tuple[float, str]]


def advice_on(effect: str, parameters: Numbers, stiffness: float, p_gain: float | None) -> tuple[Advice, ...]:
    """What to change about an effect; empty where no setting concerns it.

    stiffness: N m/rad, of the nominal model's servo, 0 where it is none. p_gain: of its register, None if not stated.
    """
    made = ADVICE.get(effect)
    return () if made is None else made(parameters, stiffness, p_gain)


def _gain(p: Numbers, stiffness: float, p_gain: float | None) -> tuple[Advice, ...]:
    gain = p["gain"]
    if stiffness <= 0.0 or gain <= 0.0:
        text = "{gain} of the modelled output is delivered; scale the commands or correct the model."
        return (Advice("supply voltage or command scale", "", text, {}),)
    acting: dict[str, tuple[float, str]] = {"now": (gain * stiffness, "N m/rad"), "model": (stiffness, "N m/rad")}
    if not REACHED[0] <= 1.0 / gain <= REACHED[1]:
        text = "it sets the stiffness, which is {now} and not the model's {model}: correct the model, not the servo."
        return (Advice("P gain", "p_gain", text, acting),)
    if p_gain is None:
        text = "{factor} times its present value would give the model's stiffness ({model} and not {now})."
        return (Advice("P gain", "p_gain", text, {**acting, "factor": (1.0 / gain, "1")}),)
    text = "{wanted} in place of {present} would give the model's stiffness ({model} and not {now})."
    return (Advice("P gain", "p_gain", text, {**acting, "wanted": (p_gain / gain, "1"), "present": (p_gain, "1")}),)


def _late(p: Numbers, stiffness: float, p_gain: float | None) -> tuple[Advice, ...]:
    """A negative delay is the log's, not the servo's."""
    text = (
        "{delay} pass before a command acts: a higher baud rate, a shorter return delay or one command for all servos "
        "shortens it."
    )
    return (Advice("bus", "reply", text, {}),) if p["delay"] > 0.0 else ()


def _fixed(setting: str, register: str, text: str) -> Callable[[Numbers, float, float | None], tuple[Advice, ...]]:
    return lambda p, stiffness, p_gain: (Advice(setting, register, text, {}),)


def _offset(p: Numbers, stiffness: float, p_gain: float | None) -> tuple[Advice, ...]:
    text = "calibrate the joint again, or shift the offset of its readings by {shift}."
    return (Advice("offset calibration", "offset", text, {"shift": (-p["bias"], "rad")}),)


ADVICE: Mapping[str, Callable[[Numbers, float, float | None], tuple[Advice, ...]]] = {
    ACTUATOR_GAIN.name: _gain,
    POSITION_GAIN.name: _gain,
    VOLTAGE_SAG.name: _fixed(
        "supply voltage", "",
        "a supply that holds its voltage (a charged battery, thicker or shorter leads) avoids the loss during a run.",
    ),
    TORQUE_SPEED_LIMIT.name: _fixed(
        "supply voltage and duty limit", "limit",
        "the torque falls with speed because the voltage is limited: a higher supply, within the servo's rating, or a "
        "higher duty limit moves the line up; slower motions stay below it.",
    ),
    SATURATION.name: _fixed(
        "torque limit", "limit",
        "the output stops at {limit}: raise the limit of torque, current or duty, if it is set below the servo's own.",
    ),
    RATE_LIMIT.name: _fixed(
        "profile rate", "profile", "the setpoint moves no faster than {rate}: a faster profile lets commands through."
    ),
    SENSOR_BIAS.name: _offset,
    DEAD_ZONE.name: _fixed(
        "dead band", "dead_band",
        "errors below {width} give no torque: a smaller dead band, or a higher P gain, holds the joint closer.",
    ),
    SERVO_INTEGRAL.name: _fixed(
        "I gain", "i_gain", "the servo integrates its error and the model does not: 0 would make it act as modelled."
    ),
    COMMAND_DELAY.name: _late,
    ACTUATOR_LAG.name: _fixed(
        "profile acceleration", "acceleration",
        "the servo follows with a lag of {time_constant}: a faster profile or a lighter filter of its setpoint, if one "
        "is set, shortens it.",
    ),
}  # fmt: skip
