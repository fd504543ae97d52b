"""A robot's model as one step x+ = f(x, u, p), for controllers, estimators and export; optional for a robot."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from residual_mpc.effects.ops import Array, Kinks, Ops
from residual_mpc.effects.ramp import ENDLESS
from residual_mpc.models.settings import Settings

BODY = ("body.forward", "body.sideways", "body.yaw")  # m/s, m/s, rad/s: the velocity signals of a robot that drives

Signals = Mapping[str, Array]
Correction = Callable[[Signals], Signals]  # signals of the step by name -> what is added to some of them


def finite(value: float) -> float:
    """A number of the model, ENDLESS in place of infinity."""
    return ENDLESS if value == float("inf") else value


@dataclass(frozen=True)
class Number:
    """One number of the model that may change without building it anew.

    effect: an effect's name, "tune" for a nominal parameter. slot: the target, empty where it is the robot. stalls:
    whether it makes the slope with respect to the command zero, as dry friction of a joint at rest does.
    """

    effect: str
    slot: str
    parameter: str
    value: float
    unit: str
    stalls: bool = False


@dataclass(frozen=True)
class Stepped:
    """One step of a model with its effects. Scalars in, scalars out: floats, (B,) arrays, JAX or CasADi scalars.

    states: names in the order of x; those in `poses` are the run log's channels, the rest is memory. commands: names
    in the order of u. numbers: the parameters p. signals: what a learned correction may read and add to.
    rest: (nx,) the state of a robot that stands at the origin (a fixed one: at its home posture) and was told nothing.
    step(kinks, x, u, p, correction) -> x+. Raises KeyError for a correction that names an unknown signal.

    What a robot tracks is its poses, unless it says otherwise: outputs: names; output(ops, x) -> their values, in
    output_units. resting(poses by name) -> x (nx,): at rest there, where memory depends on the pose.
    holding(x) -> (nu,) the commands that leave a robot about where it is; None: 0. restarts: states
    that a measurement of the poses makes 0 again. reach: (nu,) pairs of the lowest and the highest command that make
    sense, for sampling; spans: the same of the poses, where those differ. rates: states that are the poses' velocities,
    for a robot with inertia. effort(kinks, x, u, p): (nu,) the forces that the actuators would give at the step's
    beginning if nothing limited them, N m (N); strengths: (nu,) what limits them. left_out: effects of the settings
    that do not enter this step, each with the reason.
    """

    dt: float  # s
    states: tuple[str, ...]
    poses: tuple[str, ...]
    units: tuple[str, ...]  # of the states
    commands: tuple[str, ...]
    numbers: tuple[Number, ...]
    signals: tuple[str, ...]
    rest: np.ndarray
    step: Callable[[Kinks, Sequence[Array], Sequence[Array], Sequence[Array], Correction | None], tuple[Array, ...]]
    outputs: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    output: Callable[[Ops, Sequence[Array]], tuple[Array, ...]] | None = None
    resting: Callable[[Mapping[str, float]], np.ndarray] | None = None
    holding: Callable[[np.ndarray], np.ndarray] | None = None
    restarts: tuple[str, ...] = ()
    reach: tuple[tuple[float, float], ...] = ()
    left_out: tuple[str, ...] = ()
    spans: tuple[tuple[float, float], ...] = ()
    rates: tuple[str, ...] = ()
    effort: Callable[[Kinks, Sequence[Array], Sequence[Array], Sequence[Array]], tuple[Array, ...]] | None = None
    strengths: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (len(self.states) == len(self.units) == len(self.rest)):
            raise ValueError(
                f"{len(self.states)} states must come with as many units and values at rest, "
                f"got {len(self.units)} and {len(self.rest)}"
            )
        if len(set(self.states)) < len(self.states) or not set(self.poses) <= set(self.states):
            raise ValueError(f"states must be distinct and contain {self.poses}, got {self.states}")
        if len(self.outputs) != len(self.output_units) or bool(self.outputs) != (self.output is not None):
            raise ValueError(f"outputs {self.outputs} must come with {len(self.outputs)} units and one function")

    @property
    def tracked(self) -> tuple[str, ...]:
        """What a controller brings to its reference."""
        return self.outputs or self.poses

    @property
    def p(self) -> np.ndarray:
        """(np,) values of `numbers`."""
        return np.array([n.value for n in self.numbers])


@dataclass(frozen=True)
class StepOptions:
    """dt: s, the command is held over it. remember: signals whose value of the last step a correction reads
    (they become states "last.<signal>"). corrected: signals that a correction adds to. disturbances: signals to which
    an unknown constant is added, which becomes a state (offset-free tracking). clock: s since the run began at the
    start.
    """

    dt: float
    remember: tuple[str, ...] = ()
    corrected: tuple[str, ...] = ()
    disturbances: tuple[str, ...] = ()
    clock: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.dt) and self.dt > 0):
            raise ValueError(f"dt must be finite and > 0, got {self.dt} s")


@runtime_checkable
class Stepping(Protocol):
    """A robot that can say its one step. Optional: a robot without it can be diagnosed, not exported.

    Its optional members `disturbed` and `period` (`residual_mpc.models.optional`) bear on the step alone.
    """

    def one_step(self, settings: Settings, options: StepOptions) -> Stepped:
        """The step under settings of one row. Raises BadInput where that cannot be, with the reason."""
        ...
