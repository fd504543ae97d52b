"""One clause for each effect, for arms and for robots that drive."""

from collections.abc import Mapping
from dataclasses import dataclass, field

STAGES = ("command", "actuator", "body", "contact", "sensor")

# How a target is called, by the stage of the effect.
TARGETS = {
    "command": "actuator {}",
    "actuator": "actuator {}",
    "body": "joint {}",
    "contact": "{}",
    "sensor": "channel {}",
}
WHEELS = {"left": "the left wheel", "right": "the right wheel"}
EVERYONE = {
    "command": "every actuator",
    "actuator": "every actuator",
    "body": "every joint",
    "contact": "every wheel",
    "sensor": "every channel",
}


@dataclass(frozen=True)
class Phrase:
    """`text` names the parameters in braces; {who}: the target; {quantity}: what a limit's unit measures."""

    stage: str
    text: str
    everyone: str = ""  # in place of a target where there is none; else by EVERYONE
    someone: str = ""  # how the target is called, where that differs from TARGETS
    shares: tuple[str, ...] = ()  # parameters that read better as a percentage
    millionths: tuple[str, ...] = ()  # and in parts per million
    by_unit: Mapping[str, str] = field(default_factory=dict)  # unit -> the text in place of `text`

    def who(self, target: str | None) -> str:
        """The target, as the clause speaks of it."""
        if not target:
            return self.everyone or EVERYONE[self.stage]
        if target in WHEELS and not self.someone:
            return WHEELS[target]
        return (self.someone or TARGETS[self.stage]).format(WHEELS.get(target, target))


POSITION_ERRORS = "{who} ignores position errors smaller than {width}"

PHRASES = {
    "command_delay": Phrase("command", "{who} take effect {delay} late", "commands", "commands to {}"),
    "dead_zone": Phrase(
        "command",
        "{who} ignores commands smaller than {width}",
        by_unit={"rad": POSITION_ERRORS, "m": POSITION_ERRORS},
    ),
    "actuator_lag": Phrase("actuator", "{who} follows its command with a lag of {time_constant}"),
    "actuator_gain": Phrase("actuator", "{who} delivers {gain} of its modelled output", shares=("gain",)),
    "saturation": Phrase("actuator", "the {quantity} of {who} saturates at {limit}"),
    "voltage_sag": Phrase("actuator", "the gain of {who} falls by {rate} per second", shares=("rate",)),
    "backlash": Phrase("actuator", "{who} has {gap} of play", "every gear", "the gear of {}"),
    "torque_speed_limit": Phrase(
        "actuator",
        "the torque of {who} falls with its speed, from {stall_torque} at standstill to zero at {no_load_speed}",
    ),
    "rate_limit": Phrase("actuator", "the setpoint of {who} changes no faster than {rate}"),
    "servo_integral": Phrase("actuator", "{who} has an integral gain of {gain}", "every servo", "the servo of {}"),
    "coulomb_friction": Phrase("body", "{who} has {torque} more dry friction than modelled"),
    "viscous_friction": Phrase("body", "{who} has {coefficient} more viscous friction than modelled"),
    "stribeck_friction": Phrase(
        "body", "the friction of {who} differs from the model by {static} near standstill and {kinetic} at speed"
    ),
    "load_dependent_friction": Phrase(
        "body", "friction in {who} takes {coefficient} of the transmitted torque", shares=("coefficient",)
    ),
    "gear_efficiency": Phrase(
        "body",
        "{who} transmits {forward} of the torque when driving and {backward} when driven",
        "every gear",
        "the gear of {}",
        shares=("forward", "backward"),
    ),
    "joint_spring": Phrase("body", "a spring of {stiffness} pulls {who} towards {rest}"),
    "torque_offset": Phrase("body", "a constant torque of {torque} loads {who}"),
    "torque_ripple": Phrase("body", "the torque of {who} ripples by {amplitude} ({cycles})"),
    "end_stop": Phrase("body", "{who} meets an end stop at {position}"),
    "base_tilt": Phrase("body", "the base is tilted by {roll} in roll and {pitch} in pitch"),
    "payload": Phrase("body", "the robot carries {mass} more than modelled"),
    "link_mass": Phrase("body", "{who} is {mass} heavier than modelled", "every link", "link {}"),
    "armature": Phrase("body", "{who} has {inertia} more rotor inertia than modelled"),
    "joint_compliance": Phrase(
        "body", "{who} is elastic, with a stiffness of {stiffness}", "every gear", "the gear of {}"
    ),
    "link_length": Phrase("body", "{who} is {offset} longer than modelled", "every link", "link {}"),
    "wheel_radius": Phrase("contact", "the effective wheel radius is {scale} of the modelled one", shares=("scale",)),
    "wheel_radius_mismatch": Phrase(
        "contact", "the radius of the right wheel is {ratio} of that of the left wheel", shares=("ratio",)
    ),
    "track_width": Phrase("contact", "the robot turns as if its track were {scale} times as wide"),
    "lateral_slip": Phrase("contact", "the robot slips outwards in turns (coefficient {coefficient})"),
    "longitudinal_slip": Phrase("contact", "the wheels slip when they accelerate (coefficient {coefficient})"),
    "wheel_eccentricity": Phrase(
        "contact", "the radius of {who} varies by {amplitude} once per turn", shares=("amplitude",)
    ),
    "slope": Phrase("contact", "the robot drifts at {rate} in a fixed direction"),
    "sensor_delay": Phrase("sensor", "{who} arrive {delay} late", "the measurements", "the measurements of {}"),
    "sensor_lag": Phrase(
        "sensor",
        "{who} are low-pass filtered, with a time constant of {time_constant}",
        "the measurements",
        "the measurements of {}",
    ),
    "sensor_scale": Phrase("sensor", "{who} reads {scale} of the true value", shares=("scale",)),
    "clock_skew": Phrase("sensor", "the sensor clock runs {rate} fast", millionths=("rate",)),
    "sensor_bias": Phrase("sensor", "{who} reads {bias} too high"),
    "sensor_mounting": Phrase(
        "sensor", "the tracked point sits at ({x}, {y}) in the body frame, not where the model has it"
    ),
    "sensor_outliers": Phrase("sensor", "{rate} of the samples are outliers", shares=("rate",)),
}

# A clause whose parameter is negative says the opposite.
OPPOSITES = {
    "heavier": "lighter", "longer": "shorter", "too high": "too low", "more": "less", "falls by": "rises by",
    "outwards": "inwards", "{rate} fast": "{rate} slow",
}  # fmt: skip
QUANTITIES = {"rad/s": "speed", "m/s": "speed", "N m": "torque", "N": "force", "rad": "position", "m": "position"}
