"""What the diagnosis needs of a robot: to replay a batch of windows under a batch of hypotheses."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from residual_mpc.models.past_errors import PastErrors
from residual_mpc.models.settings import Settings


@dataclass(frozen=True)
class State:
    """One coordinate of the start state: the channel it is read from, and that of its rate (None: it has none)."""

    position: str
    velocity: str | None

    @property
    def sources(self) -> tuple[tuple[str, str, bool], ...]:
        """(what is started, the channel it is fitted to, whether the fit's slope gives it), later ones overriding."""
        value = ((self.position, self.position, False),)
        if self.velocity is None:
            return value
        return (*value, (self.velocity, self.position, True), (self.velocity, self.velocity, False))


@dataclass(frozen=True)
class Drive:
    """What the controller sent, on the replay's own grid of steps of dt; B rows, K steps, nu actuators.

    command (B, lead + K, nu): mean over each step of the command held, actuator units; the first `lead` steps lie
    before the window and warm up what remembers. enabled (B, K, nu) of 0 or 1, or None where always on.
    enabled_before (B, lead, nu): the same before the window, for who begins a replay earlier; command_after and
    enabled_after (B, A, nu): after the window, for who ends it later; a robot needs none of these.
    clock (B,) s from the run's first stamp to the window's start. angle (B, nu) rad of each wheel at the window's
    start, counted from where its radius is the largest; None where nothing is known of it. past: what the position
    servos had to correct before; None where nothing is known of it, and they count as settled. setting (B,) which
    setting of a merged robot each row has, None for a robot with one. midway: whether the replay carries on from where
    one before it ended, and not from a measured start: what no channel tells then begins by rule, without a replay of
    the commands before.
    """

    dt: float
    lead: int
    command: np.ndarray
    enabled: np.ndarray | None
    clock: np.ndarray
    setting: np.ndarray | None = None
    enabled_before: np.ndarray | None = None
    midway: bool = False
    past: PastErrors | None = None
    command_after: np.ndarray | None = None
    enabled_after: np.ndarray | None = None
    angle: np.ndarray | None = None

    @property
    def steps(self) -> int:
        return self.command.shape[1] - self.lead

    @property
    def on(self) -> np.ndarray | None:
        """(B, lead + K, nu) of 0 or 1, 1 before the window where nothing is known of it; None where always on."""
        if self.enabled is None:
            return None
        before = self.enabled_before
        if before is None:
            before = np.ones((len(self.enabled), self.lead, self.enabled.shape[-1]))
        return np.concatenate([before, self.enabled], axis=1)

    @property
    def clock_at_steps(self) -> np.ndarray:
        """(B, lead + K, 1) s from the run's first stamp to the middle of each step, 0 before it."""
        middle = self.dt * (np.arange(self.command.shape[1]) - self.lead + 0.5)
        return np.asarray(np.maximum(self.clock[:, None, None] + middle[None, :, None], 0.0))

    def angle_before(self, steps: np.ndarray) -> np.ndarray | None:
        """(..., B, nu) rad of the wheels `steps` (..., B) before the window, which turned as commanded since then;
        None where nothing is known of it."""
        if self.angle is None:
            return None
        before = self.command[:, : self.lead][:, ::-1]
        turned = self.dt * np.concatenate([np.zeros_like(self.angle)[:, None], np.cumsum(before, axis=1)], axis=1)
        return np.asarray(self.angle - turned[np.arange(len(turned)), np.clip(steps, 0, self.lead)])

    def take(self, rows: np.ndarray) -> "Drive":
        """The rows where the mask (B,) is true."""
        some = ("enabled", "setting", "enabled_before", "command_after", "enabled_after", "angle")
        known = {name: value[rows] for name in some if (value := getattr(self, name)) is not None}
        past = None if self.past is None else self.past.take(rows)
        return replace(self, command=self.command[rows], clock=self.clock[rows], past=past, **known)


class Robot(Protocol):
    """A model that can be replayed: what every robot has to say.

    `residual_mpc.models.optional` declares what it may say besides, with the defaults; `residual_mpc.models.contract`
    checks an implementation of yours.
    """

    @property
    def name(self) -> str: ...

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names after `command.`, in the order of Drive.command's last axis."""
        ...

    @property
    def command_kinds(self) -> tuple[str, ...]:
        """For each actuator "position", "velocity", "torque" or "speed" (a wheel)."""
        ...

    @property
    def states(self) -> tuple[State, ...]: ...

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel that `replay` can predict, by the run log's names."""
        ...

    @property
    def step(self) -> float | None:
        """The step that the model insists on, s; None where any will do."""
        ...

    def slots(self, effect: str) -> tuple[str, ...]:
        """The targets that the effect can have on this robot; empty where it cannot have the effect."""
        ...

    def bounds(self, effect: str, parameter: str, slot: str | None) -> tuple[float, float]:
        """Physical limits of a parameter on this robot (a mass that is added may not make the whole negative)."""
        ...

    def reference(self, kind: str, slot: str | None) -> float:
        """A typical "inertia", "mass" or "length" of the target, for scaling; 1.0 where it has none. "play": how many
        times a wheel's play (0.03 to 0.5 rad) its own may be."""
        ...

    def nominal(self) -> Mapping[str, float]:
        """The model's own parameters by name: what `tunable` may name."""
        ...

    def replay(
        self, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        """Predicted channels on the nodes of the grid, each (B, K + 1).

        start: for each State its position and velocity channel, (B,). settings has B rows. `wanted` may also name
        `output.<actuator>`: the actuator's output (force, or wheel speed).
        """
        ...


@runtime_checkable
class Merging(Protocol):
    """A robot that can take other settings of itself into one batch. Optional: it saves time."""

    def merged(self, others: "list[Robot]") -> "Robot | None":
        """One robot for all of them, told apart by Drive.setting; None where that cannot be."""
        ...


@runtime_checkable
class Inverting(Protocol):
    """A robot that can tell from how it moves what its actuators do. Optional: where no sensor sits on an actuator, it
    says whether the robot stood still before the first stamp."""

    def outputs_from(self, value: Mapping[str, float], rate: Mapping[str, float]) -> Mapping[str, float]:
        """Actuator -> output, from the values and rates (per second) of the states' position channels."""
        ...
