"""What an unmodelled effect is: where on a robot it acts, its equation, its parameters with their null values, and what
the other parts of the program have to know of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, cast

from residual_mpc.effects.ops import Array, Ops
from residual_mpc.effects.phrase import Noun, Phrase

Stage = Literal["command", "actuator", "body", "contact", "sensor"]
Port = Literal["command", "output", "pair", "speed", "servo", "friction", "torque", "ground", "sensor", "model", "law"]
TargetKind = Literal["actuator", "joint", "body", "channel", "robot"]
Reference = Literal[
    "one", "command", "command/time", "output", "speed", "torque", "torque/speed", "torque/motion", "extremes",
    "reach", "inertia", "mass", "length", "play", "1/run",
    "1/torque", "turn", "forward/time", "turn/time",
]  # fmt: skip
Values = Mapping[str, Array]  # parameter name -> value, an array that broadcasts over the signal

# The places of a robot at which an effect can act. A robot names its targets at each place that it has.
Site = Literal[
    "command",  # a command on its way to the actuator
    "strength",  # a factor on the actuator's output (its force; of a wheel its speed)
    "limit",  # a limit of the actuator's output
    "speed limit",  # a limit of the actuator's output that depends on its speed
    "servo",  # how a position servo turns its error into a force
    "position gain",  # how stiffly a position servo with damping of its own holds its setpoint
    "output",  # any other change of the actuator's output
    "pair",  # the speeds of two wheels together
    "pair command",  # their commands together, as a base controller passes them on
    "play",  # free motion between motor and link
    "spring",  # elasticity between motor and link
    "dry friction",  # a constant torque against a joint's motion
    "friction",  # a torque against a joint's motion that depends on speed or load
    "damping",  # a joint's viscous damping
    "elastic",  # a torque on a joint that is constant or linear in its position
    "stop",  # a stop of a joint
    "rotor",  # a rotor's inertia at a joint
    "tool",  # a mass at the payload site
    "gravity",  # the direction of gravity in the base frame
    "compensation",  # torques of the controller that bear the modelled robot's weight
    "link",  # a link's mass and centre of mass
    "length",  # the distance of two joints along a link
    "rolling",  # wheel radii and track
    "roundness",  # a wheel's radius over its turn
    "rim",  # the speed of a wheel's rim over the ground
    "side",  # sideways motion of the base
    "drift",  # motion of the base in the world
    "delay",  # the age of a reading
    "clock",  # the clock that stamps the readings
    "offset",  # a constant in a reading
    "range",  # a factor on a reading
    "encoder",  # the disc of an encoder on its shaft
    "filter",  # how fast a reading follows
    "point",  # the tracked point on the body
    "samples",  # single samples of a reading
    "law",  # a torque on a joint that is any function of its position, speed, command, load or the time
    "law friction",  # a dry friction of a joint that is any function of its position or the time
    "rate",  # the base's own rates: forward, sideways, yaw
]
# What a parameter changes of the model. Factors multiply it, everything else adds to it.
Quantity = Literal[
    "command delay", "command lag",  # s
    "wheel radius", "right wheel radius", "track width",  # factors
    "dry friction",  # N m
    "viscous damping",  # N m s/rad
    "rotor inertia",  # kg m^2
    "tool mass", "link mass",  # kg
    "tool x", "tool y", "tool z",  # m, where that mass is, from the payload site along its axes
    "link centre", "link length",  # m
    "servo stiffness",  # a factor
    "gear stiffness",  # N m/rad
    "gear damping",  # of critical
    "gear play",  # rad
    "damping behind the gear",  # of the joint's damping in the model
    "ripple lead",  # s
    "gravity roll", "gravity pitch",  # rad
    "compensated gravity",  # the share of the modelled gravity that the controller bears
    "joint stop",  # rad
    "reading delay",  # s
    "reading offset",  # the channel's unit
    "reading scale",  # a factor
    "reading lag",  # s
    "reading skew",  # s that its clock gains in a second
]  # fmt: skip

STAGES: tuple[Stage, ...] = ("command", "actuator", "body", "contact", "sensor")


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    `probes` are values worth a first look, in units of the reference named by `reference`, which the robot measures on
    the runs at hand ("one" is the parameter's own unit; "command" the range of the target's command, "output" the peak
    and "torque" the root mean square of the actuator's output that the nominal model predicts; "speed" is the
    actuator's largest; "torque/speed" and "torque/motion" the torque over the joint's typical speed and over the size
    of its motion; "command/time" the command's range in one second; "1/run" is one over the longest run, 1/s,
    "1/torque" one over the torque; "extremes" stands for the highest (a positive probe) and the lowest (a negative one)
    position that the runs reach; "turn" is the peak of half the difference of two wheels' speeds; "forward/time" and
    "turn/time" are the ranges of the mean and of half the difference of their commands, in one second; "reach" is
    one radian (on a sliding joint its range in the runs), from the middle of the joint's motion; "inertia", "mass",
    "length" and "play" are the robot's own).
    """

    name: str
    unit: str
    null: float
    lower: float
    upper: float
    probes: tuple[float, ...]
    reference: Reference = "one"
    threshold: bool = False  # acts by comparison, so that derivatives say little: the fit also scans it
    tolerance: float = 0.0  # by which a well-made robot differs from its model, in units of the reference
    shape: bool = False  # says how the effect acts, not how much: more of the effect does not change it
    quantity: Quantity | None = None  # of the model, which this number changes
    # largest value worth a fit, in units of the largest reference of its targets; as far below a null with values below
    most: float = float("inf")
    within: Reference | None = None  # the robot's own size that this number stays within, on both sides
    optional: bool = False  # stays at its null value unless the runs show that it has another
    physical_bounds: bool = False  # at its bounds a value is no sign of a wrong effect
    tried: float | None = None  # the value of an optional number at which the other numbers' probes are tried as well
    cover: float = 0.0  # of a number of cycles a turn: the cycles that a joint has to turn through, to show them

    def __post_init__(self) -> None:
        if not self.lower <= self.null <= self.upper:
            raise ValueError(f"parameter {self.name}: null {self.null} outside [{self.lower}, {self.upper}]")


@dataclass(frozen=True)
class Effect:
    """One unmodelled effect, with all that the program knows of it.

    `port` says which signature the equation has:

    - command:  start(ops, p, u, dt) -> memory;  step(ops, p, memory, u, dt) -> (u, memory)
    - output:   start(ops, p, y) -> memory;  step(ops, p, memory, y, clock, dt) -> (y, memory); clock is s since the
      run began
    - pair:     start(ops, p, left, right, dt) -> memory;  step(ops, p, memory, left, right, dt) -> ((left, right),
      memory), the speeds of two wheels or at the site "pair command" their commands, rad/s
    - speed:    step(ops, p, w) -> lowest and highest output at the actuator's speed w, rad/s
    - servo:    step(ops, p, x, error, dt) -> x after dt, which is added to the setpoint of a position servo
    - friction: step(ops, p, w, tau) -> torque against the motion, N m (times sgn(w))
    - torque:   step(ops, p, q) -> torque on the joint at position q, N m; at the site "elastic" linear in q, at the
      site "law" step(ops, p, q, w), with the joint's speed w
    - ground:   by site; roundness: step(ops, p, angle) -> factor on a wheel's radius at its angle, rad; rim: step(ops,
      p, v, a) -> v, a rim's speed m/s and acceleration m/s^2; side: step(ops, p, forward, yaw) -> m/s to the left;
      drift: step(ops, p) -> (m/s, m/s) in the world
    - sensor:   at the point: step(ops, p, x, y, theta) -> (x, y), and `undo`, its inverse; at the encoder: step(ops, p,
      q) -> what is added to the reading of the position q, rad
    - model:    no equation: its parameters change quantities of the model
    - law:      step(ops, p, z) -> what is added, at the value z of the quantity that the law is a function of
    """

    name: str
    stage: Stage
    port: Port
    target: TargetKind
    parameters: tuple[Parameter, ...]
    summary: str
    start: Callable[..., Any] | None = None
    step: Callable[..., Any] | None = None
    null_target: bool = True  # whether "all targets alike" is a hypothesis of its own
    sensible: Callable[[Mapping[str, float]], bool] | None = None  # rules out values that only imitate another effect
    site: Site | None = None  # None: the port's own (command, output, friction)

    # the chain
    rank: int = 50  # order among the effects of a port, smallest first
    on_error: bool = False  # at a position servo it acts on the position error instead of the command
    inertial: bool = False  # acts on a command, but where an actuator's output is a speed on what its limit leaves
    timed: bool = True  # the equation of an output reads the clock
    steady: bool = False  # what it does to an output or joint changes neither with time nor with the motion
    supply: bool = False  # acts on the actuator's supply: the limit of its force follows
    sequence: Callable[[Values, Array, float], Array] | None = None  # (p, u (B, K, n), dt): a whole run of commands
    # (p, u, end, y, dt): the end of y in each step; u and y are means over it
    at_end: Callable[[Values, Array, Array, Array, float], Array] | None = None
    trim: Callable[[Any, Values, float], Any] | None = None  # (memory, p, dt): as much of the memory as p needs
    label: str = ""  # of its memory in the states of a step; default its name
    memory_unit: str = ""  # default the signal's
    rounded: Callable[..., Array] | None = None  # (ops, p, u, width), no memory: without its kink
    kink: Literal["none", "signal", "step"] = "none"  # what kinks: nothing, the signal, or the signal times dt
    stalls: tuple[str, ...] = ()  # parameters that make the slope with respect to the command zero
    undo: Callable[..., Any] | None = None

    # the diagnosis
    fitted: bool = True  # its parameters are fitted; otherwise samples are flagged and counted
    proposed: bool = False  # a first look is worth taking only where what is left suggests it, not at the probes
    seconds: float = 0.0  # s that a run has to last for the effect to show
    lacking: str = ""  # why a robot whose joints are measured cannot show it, where it has no place for the effect
    unseen: str = "its largest plausible size moves the prediction by less than the noise"  # why runs do not show it
    imitates: frozenset[str] = frozenset()  # dependences of a remainder that this effect is mistaken for
    # fitted laws that are this effect: what they add, the quantity (None for any) and their form
    laws: tuple[tuple[str, str | None, str], ...] = ()
    shadows: tuple[tuple[Quantity, float], ...] = ()  # (quantity, share): its size that such a number may feign
    # the effect that this one is where two of its parameters are equal, and these
    equal: tuple[str, tuple[str, str]] | None = None
    interchangeable: str = ""  # effects with the same word do the same in pairs

    # the words
    listed: bool = True  # in the contract's table; of a confounded group, effects that are not stand last
    phrase: Phrase | None = None
    nouns: Mapping[str, Noun] = field(default_factory=dict)  # parameter -> what it is called where it changed
    not_in_mjcf: str = ""  # why an MJCF cannot hold it; empty where it can
    in_mjcf: str = ""  # what of it an MJCF holds, where that is not all
    settled: Callable[[Values], Array] | None = None  # constant dry friction that comes nearest to it, N m

    own: bool = field(default=False, compare=False)  # a user's own, found by entry point

    @property
    def place(self) -> Site:
        """The site; without one the port's own, which the command, output and friction ports have."""
        return self.site or cast(Site, self.port)

    @property
    def remembers(self) -> bool:
        """Whether the equation has memory."""
        return self.start is not None and self.start is not no_memory

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError otherwise."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise KeyError(name)


def no_memory(ops: Ops, p: Values, *signal: Array) -> tuple[()]:
    """The memory of an effect that has none."""
    return ()
