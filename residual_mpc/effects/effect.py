"""What an unmodelled effect is: a stage of the chain, an equation, parameters with a null value, memory if it has
one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from residual_mpc.effects.ops import Array, Ops

Stage = Literal["command", "actuator", "body", "contact", "sensor"]
Port = Literal["command", "output", "friction", "ground", "sensor", "model"]
TargetKind = Literal["actuator", "joint", "body", "channel", "robot"]
Reference = Literal["one", "command", "output", "torque", "torque/speed", "inertia", "mass", "length", "play"]
Values = Mapping[str, Array]  # parameter name -> value, an array that broadcasts over the signal

STAGES: tuple[Stage, ...] = ("command", "actuator", "body", "contact", "sensor")


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    `probes` are values worth a first look, in units of the reference named by `reference`, which the robot
    measures on the runs at hand ("one" is the parameter's own unit; "command" the range of the target's command,
    "output" the peak and "torque" the root mean square of the actuator's output that the nominal model predicts;
    "inertia", "mass", "length" and "play" are the robot's own).
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

    def __post_init__(self) -> None:
        if not self.lower <= self.null <= self.upper:
            raise ValueError(f"parameter {self.name}: null {self.null} outside [{self.lower}, {self.upper}]")


@dataclass(frozen=True)
class Effect:
    """One unmodelled effect.

    `port` says which signal of the chain the equation takes; the signatures are

    - command:  start(ops, p, u, dt) -> memory;  step(ops, p, memory, u, dt) -> (u, memory)
    - output:   step(ops, p, memory, y, clock, dt) -> (y, memory), start(ops, p, y) -> memory; clock is s since the
    run began
    - friction: level(ops, p, w, tau) -> torque against the motion, N m (times sgn(w)); for viscous friction the
      coefficient itself multiplies w
    - ground:   see contact.py;  sensor: see sensor.py
    - model:    no equation; the robot edits its own model
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

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError otherwise."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise KeyError(name)


def no_memory(ops: Ops, p: Values, *signal: Array) -> tuple[()]:
    """The memory of an effect that has none."""
    return ()
