"""What sets the twin apart from its models: for scoring alone. Nothing that learns or diagnoses opens this record."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from plants.scaler_arm.dynamics.stick_slip import Sticking
from plants.scaler_arm.kinematics.geometry import Arm, Body
from plants.withheld_effects import Named, named, records
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.body import PAYLOAD, VISCOUS
from residual_mpc.effects.command import COMMAND_DELAY
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class Withheld:
    """Effects that a twin has and nobody is told of; the defaults do nothing.

    delay s of every command; payload kg at the tool point; gain of the servos (stiffness and damping alike); friction
    N m s/rad added at every motor; sticking of the gears; counts of an encoder a turn, 0 for infinitely many.
    """

    delay: float = 0.0
    payload: float = 0.0
    gain: float = 1.0
    friction: float = 0.0
    sticking: Sticking = Sticking()
    counts: int = 0

    def __post_init__(self) -> None:
        if not (self.delay >= 0 and self.payload >= 0 and self.gain > 0 and self.friction >= 0 and self.counts >= 0):
            raise BadInput(f"gain must be > 0 and the other sizes >= 0, got {self}", "withheld effects")

    def effects(self) -> Named:
        """Those that the library has."""
        return named(
            (COMMAND_DELAY, self.delay), (PAYLOAD, self.payload), (ACTUATOR_GAIN, self.gain), (VISCOUS, self.friction)
        )


TYPICAL = Withheld(
    delay=0.0237,
    payload=0.113,
    gain=0.62,
    friction=0.31,
    sticking=Sticking(stick=0.006, slip=0.002, slowest=0.02),
    counts=4096,
)


def draw_withheld(rng: np.random.Generator) -> Withheld:
    """An arm of worn servos that carries something: every effect, each of a size drawn about TYPICAL's."""
    stick = rng.uniform(0.004, 0.009)
    return Withheld(
        delay=float(rng.uniform(0.012, 0.035)),
        payload=float(rng.uniform(0.06, 0.2)),
        gain=float(rng.uniform(0.5, 0.8)),
        friction=float(rng.uniform(0.1, 0.5)),
        sticking=Sticking(stick=float(stick), slip=float(stick * rng.uniform(0.2, 0.5)), slowest=0.02),
        counts=4096,
    )


def really(arm: Arm, withheld: Withheld) -> Arm:
    """The arm with the withheld payload, servo gain and friction."""
    servo = replace(
        arm.servo,
        stiffness=arm.servo.stiffness * withheld.gain,
        damping=arm.servo.damping * withheld.gain,
        friction=arm.servo.friction + withheld.friction,
    )
    return replace(arm, servo=servo, gripper_body=_loaded(arm.gripper_body, arm.tool, withheld.payload))


def truth(withheld: Withheld, engine: str) -> dict[str, Any]:
    """The record that scoring opens: effects of the library by their names, and causes that no library names."""
    beyond = [f"the engine: {engine}"]
    law = withheld.sticking
    if np.any(np.asarray(law.stick) > 0):
        beyond.append(f"stick and slip: {np.max(law.stick)} rad to break away, {np.max(law.slip)} rad behind")
    if withheld.counts:
        beyond.append(f"encoders of {withheld.counts} counts a turn")
    effects = records(withheld.effects())
    return {"schema": "residual-mpc/truth/1", "robot": "scaler_arm", "effects": effects, "beyond": beyond}


def _loaded(body: Body, at: tuple[float, float, float], mass: float) -> Body:
    """The body with a point mass kg at `at` m; the products of inertia that it makes are left out, as elsewhere."""
    if mass == 0.0:
        return body
    total = body.mass + mass
    com = tuple((body.mass * c + mass * a) / total for c, a in zip(body.com, at, strict=True))
    offsets = [(body.mass, [c - m for c, m in zip(body.com, com, strict=True)])]
    offsets.append((mass, [a - m for a, m in zip(at, com, strict=True)]))
    inertia = list(body.inertia)
    for weight, (x, y, z) in offsets:
        for i, square in enumerate((y * y + z * z, x * x + z * z, x * x + y * y)):
            inertia[i] += weight * square
    return Body(total, (com[0], com[1], com[2]), (inertia[0], inertia[1], inertia[2]))
