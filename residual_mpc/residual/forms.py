"""The equations that a residual enters: which velocities it corrects, from which inputs, and how it is rolled out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings

Delta = Callable[[np.ndarray], np.ndarray]  # inputs z (B, inputs) -> residual (B, outputs), physical units


@dataclass(frozen=True, eq=False)
class Rolled:
    """B rows rolled out over N steps of the residual.

    nodes: wanted channels (B, K + 1). z (B, N, inputs) and delta (B, N, outputs): what went in and came out. velocity
    (B, N, outputs): the velocities that the residual corrects, corrected, mean over each step (a joint's: at its end).
    """

    nodes: Mapping[str, np.ndarray]
    z: np.ndarray
    delta: np.ndarray
    velocity: np.ndarray


class Form(Protocol):
    """One way in which delta enters a robot's model."""

    @property
    def name(self) -> str: ...

    def inputs(self, base: Robot) -> tuple[str, ...]:
        """Names of z."""
        ...

    def outputs(self, base: Robot) -> tuple[str, ...]:
        """Names of delta's components."""
        ...

    def moved_by(self, base: Robot, channel: str) -> tuple[str, ...]:
        """The outputs that move a position-like channel directly."""
        ...

    def roll(
        self,
        base: Robot,
        delta: Delta,
        step: float,
        start: Mapping[str, np.ndarray],
        drive: Drive,
        settings: Settings,
        wanted: tuple[str, ...],
        push: np.ndarray | None = None,
    ) -> Rolled:
        """As Robot.replay, with delta evaluated every `step` s and held. push (B, N, outputs) is added to delta."""
        ...


def steps_of(step: float, drive: Drive) -> tuple[int, int]:
    """(grid steps a residual's step, residual steps in the window)."""
    sub = max(1, round(step / drive.dt))
    return sub, -(-drive.steps // sub)


def form_named(name: str) -> Form:
    """The form of a record. Raises BadInput for a name that no form has."""
    from residual_mpc.residual.body import BodyForm, PaperForm
    from residual_mpc.residual.joint import JointForm

    known: dict[str, Form] = {f.name: f for f in (BodyForm(), PaperForm(), JointForm())}
    if name not in known:
        raise BadInput(f"a residual of form {name!r} cannot be simulated", "", f"forms that can: {', '.join(known)}")
    return known[name]


def usual_form(base: Robot) -> Form:
    """The body form for a robot that drives on a plane, else the joint form."""
    from residual_mpc.residual.body import POSE

    return form_named("body" if set(POSE) <= {s.position for s in base.states} else "joint")
