"""Sizes of the parts of an arm, read off its model's file: what a joint carries, how far away."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from residual_mpc.blind.recorded.inertial import inertial_of
from residual_mpc.blind.recorded.mjcf import Mjcf, Vector, place, turned

GRAVITY = 9.81  # m/s^2


def moving(model: Mjcf) -> list[ET.Element]:
    """Bodies that a joint of their own or of a body before them moves."""
    held = {b: b.find("joint") is not None or b.find("freejoint") is not None for b in model.bodies()}
    found: list[ET.Element] = []
    for body in held:  # parents come first
        if held[body] or model.parents[body] in found:
            found.append(body)
    return found


def lifted(model: Mjcf) -> list[ET.Element]:
    """Moving bodies that some joint moves up or down in the model's own pose: their weight shows."""
    turns: dict[ET.Element, Vector] = {}
    seen: dict[ET.Element, bool] = {}
    for body in model.bodies():
        above = model.parents[body]
        turns[body] = turns.get(above, np.eye(3)) @ turned(body)
        axes = [turns[body] @ model.numbers(j, "axis", (0.0, 0.0, 1.0)) for j in body.findall("joint")]
        seen[body] = seen.get(above, False) or any(np.hypot(a[0], a[1]) > 0.1 * np.linalg.norm(a) for a in axes)
    return [body for body in moving(model) if seen[body]]


def moving_mass(model: Mjcf) -> float:
    """kg."""
    return sum(inertial_of(model, body).mass for body in moving(model))


def carried(model: Mjcf, joint: str) -> tuple[float, float]:
    """(kg m^2, N m): the inertia and the weight's torque about a joint if all that it carries were stretched out."""
    body = model.parents[model.joint(joint)]
    inertia = torque = 0.0
    stack = [(body, 0.0)]
    while stack:
        here, reach = stack.pop()
        own = inertial_of(model, here)
        distance = reach + float(np.linalg.norm(own.centre))
        inertia += own.mass * distance**2
        torque += GRAVITY * own.mass * distance
        stack += [(child, reach + float(np.linalg.norm(place(child)))) for child in here.findall("body")]
    return inertia, torque


def next_link(model: Mjcf, body: ET.Element) -> ET.Element | None:
    """The one body that hangs on this link by its own joint, if both joints sit at their bodies' origins."""
    after = body.findall("body")
    joints = [*body.findall("joint"), *(j for b in after for j in b.findall("joint"))]
    if len(after) != 1 or len(joints) != 2 or len(body.findall("joint")) != 1:
        return None
    if any(np.any(place(j)) for j in joints) or not np.any(place(after[0])):
        return None
    return after[0]
