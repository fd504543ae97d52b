"""Each effect in a sentence for someone who has never heard its name."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from residual_mpc.report.words.numbers import measure, percent

STAGES = ("command", "actuator", "body", "contact", "sensor")


# Whom a target names, by the stage of the effect.
TARGETS = {
    "command": "the actuator {}",
    "actuator": "the actuator {}",
    "body": "the joint {}",
    "contact": "{}",
    "sensor": "the channel {}",
}
WHEELS = {"left": "the left wheel", "right": "the right wheel"}


@dataclass(frozen=True)
class Phrase:
    """`text` names the parameters in braces, and {who}: the target, or `everyone` where there is none."""

    stage: str
    text: str
    everyone: str = "the robot"
    someone: str = ""  # how the target is called, where that differs from TARGETS
    shares: tuple[str, ...] = ()  # parameters that read better as a percentage

    def who(self, target: str | None) -> str:
        if not target:
            return self.everyone
        return (self.someone or TARGETS[self.stage]).format(WHEELS.get(target, target)).replace(
            "the actuator the", "the").replace("the joint the", "the")  # fmt: skip


PHRASES = {
    "command_delay": Phrase("command", "{who} answers {delay} late"),
    "dead_zone": Phrase("command", "{who} ignores commands smaller than {width}"),
    "actuator_lag": Phrase("actuator", "{who} follows commands with a lag of {time_constant}"),
    "actuator_gain": Phrase(
        "actuator", "{who} gives {gain} of what the model expects", "every actuator", shares=("gain",)
    ),
    "saturation": Phrase("actuator", "{who} stops at {limit}", "every actuator"),
    "voltage_sag": Phrase("actuator", "{who} loses {rate} of its strength each second", shares=("rate",)),
    "backlash": Phrase("actuator", "{who} has {gap} of play", "every gear", "the gear of {}"),
    "coulomb_friction": Phrase("body", "dry friction of {torque} brakes {who}", "every joint"),
    "viscous_friction": Phrase("body", "friction of {coefficient} grows with the speed of {who}", "every joint"),
    "stribeck_friction": Phrase(
        "body", "friction in {who} falls from {static} at rest to {kinetic} in motion", "every joint"
    ),
    "load_dependent_friction": Phrase(
        "body", "friction eats {coefficient} of the torque at {who}", "every joint", shares=("coefficient",)
    ),
    "payload": Phrase("body", "the robot carries {mass} that its model lacks"),
    "link_mass": Phrase("body", "{who} is {mass} heavier than modelled", "the link", "the link {}"),
    "armature": Phrase("body", "the rotor of {who} has {inertia} more inertia than modelled", "every joint"),
    "joint_compliance": Phrase("body", "{who} gives way like a spring of {stiffness}", "every joint"),
    "link_length": Phrase("body", "{who} is {offset} longer than modelled", "the link", "the link {}"),
    "wheel_radius": Phrase(
        "contact", "the wheels roll {scale} of the distance that the model expects", shares=("scale",)
    ),
    "wheel_radius_mismatch": Phrase(
        "contact", "the right wheel has {ratio} of the left wheel's radius", shares=("ratio",)
    ),
    "track_width": Phrase(
        "contact", "the robot turns as if its wheels stood at {scale} of their distance", shares=("scale",)
    ),
    "lateral_slip": Phrase("contact", "the robot slips outwards in turns (coefficient {coefficient})"),
    "longitudinal_slip": Phrase("contact", "the wheels slip as they accelerate (coefficient {coefficient})"),
    "slope": Phrase("contact", "the robot drifts steadily at {rate}"),
    "sensor_delay": Phrase("sensor", "{who} arrive {delay} late", "the measurements", "the measurements of {}"),
    "sensor_bias": Phrase("sensor", "{who} reads {bias} too high", "every channel"),
    "sensor_mounting": Phrase(
        "sensor", "the tracked point sits at ({x}, {y}) on the robot, not where the model has it"
    ),
    "sensor_outliers": Phrase("sensor", "{rate} of the samples jump away", shares=("rate",)),
}

# A sentence whose parameter is negative says the opposite.
OPPOSITES = {"heavier": "lighter", "longer": "shorter", "too high": "too low", "more inertia": "less inertia"}


def name(effect: Mapping[str, Any]) -> str:
    """{"effect": "command_delay", ...} as "command delay"."""
    return str(effect["effect"]).replace("_", " ")


def stage(effect: Mapping[str, Any]) -> str:
    """The stage of the chain at which the effect sits; empty for an effect that this house does not know."""
    phrase = PHRASES.get(effect["effect"])
    return str(effect.get("stage") or (phrase.stage if phrase else ""))


def sentence_of(effect: Mapping[str, Any]) -> str:
    """One entry of an explanation as a clause without a full stop: "the robot answers 81 ms late".

    An effect from somewhere else, or one without its parameters, is called by its name.
    """
    phrase, parameters = PHRASES.get(effect["effect"]), effect.get("parameters") or {}
    target = effect.get("target") or effect.get("only_target")
    if phrase is None:
        return f"{name(effect)} acts on {target or 'the robot'}"
    text, values = phrase.text, {}
    for key, parameter in parameters.items():
        if parameter.get("value") is None:
            continue
        value = parameter["value"]
        if value < 0 and f"{{{key}}}" in phrase.text:  # a number that the clause does not name turns no word round
            text, value = _opposite(text, value)
        unit = parameter.get("unit", "1")
        values[key] = percent(value) if key in phrase.shares else measure(value, unit)
    try:
        return text.format(who=phrase.who(target), **values)
    except KeyError:
        return f"{name(effect)} acts on {phrase.who(target)}"


def _opposite(text: str, value: float) -> tuple[str, float]:
    for word, opposite in OPPOSITES.items():
        if word in text:
            return text.replace(word, opposite), -value
    return text, value
