"""What no run shows: numbers of joints that stand still, and effects that repeat with an angle that hardly turns."""

from collections.abc import Collection, Mapping

import numpy as np

from residual_mpc.diagnosis.predict.references import turned_of
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Term

PART_OF_A_TURN = 1.0  # rad that a joint has to turn, for a sine of its angle to differ from a line


def numbers_of_still(robot: Robot, still: Collection[str]) -> tuple[str, ...]:
    """Prefixes of the names of the nominal numbers of joints that stand still, and of their actuators."""
    driven = zip(robot.actuators, optional.actuator_joints(robot), strict=True)
    resting = [j for j in optional.joints(robot) if f"position.{j}" in still]
    return (*(f"joint.{j}." for j in resting), *(f"actuator.{a}." for a, j in driven if j in resting))


def uncovered(term: Term, slots: tuple[str, ...], robot: Robot, references: Mapping[tuple[str, str], float]) -> str:
    """Why no run shows an effect that repeats with a joint's angle; empty where one may, and for other effects."""
    effect, slot = BY_NAME[term.effect], slots[0] if term.target is None else term.target
    joint = slot.removeprefix("position.")
    if effect.place == "encoder":
        turned = turned_of(references, joint)
        like = "over which its error is a scale and a bias"
        return "" if turned > PART_OF_A_TURN else f"the joint turns by {turned:.2g} rad, {like}"
    least = [p for p in effect.parameters if p.cover]
    if not least:
        return ""
    if joint in optional.sliding(robot):
        return "the joint is prismatic and has no angle"
    turned = turned_of(references, joint)
    enough = least[0].cover * 2.0 * np.pi / least[0].upper
    return (
        ""
        if turned > enough
        else f"the joint turns by {turned:.2g} rad, less than the shortest ripple period in the search"
    )
