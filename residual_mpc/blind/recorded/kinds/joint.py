"""Changes of joints and of their actuators, put into the model."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np

from residual_mpc.blind.recorded.chain import carried
from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.body import models_of
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target, between, factor, refuse, signed
from residual_mpc.blind.recorded.mjcf import Mjcf, parse, vector_text
from residual_mpc.effects.actuator import ACTUATOR_GAIN
from residual_mpc.effects.body import ARMATURE, COULOMB, VISCOUS
from residual_mpc.effects.position_servo import POSITION_GAIN

# by kind of actuator, the attributes that its force is proportional to, with their defaults and the power of the gain
# that they are multiplied by; a motor's limit lies before its gear, which is the only factor that it has
GAIN_OF = {
    "motor": (("gear", "1 0 0 0 0 0", -1), ("forcerange", "", 1)),
    "position": (("kp", "1", -1), ("kv", "0", -1)),
    "velocity": (("kv", "1", -1),),
    "general": (("gainprm", "1", -1), ("biasprm", "0", -1)),
}
STATED_OTHERWISE = ("dampratio", "timeconst", "inheritrange")


def _joints(effect: str) -> Callable[[Half], tuple[Target, ...]]:
    def targets(half: Half) -> tuple[Target, ...]:
        models = models_of(half, effect)
        for model in models:
            for joint in half.joints:
                carried(model, joint)
        if not half.joints:
            raise refuse(effect, "no run measures a joint's position")
        return half.joints

    return targets


def _scale(half: Half, joint: Target, attribute: str, carried_alone: float, times: float) -> float:
    """What a size is a share of: what the joint carries, or ``times`` the model's own where that is more (a geared
    wrist carries less than its own friction and rotor)."""
    model = parse(half.settings[0].model)
    return max(carried_alone, times * model.number(model.joint(str(joint)), attribute, 0.0))


def _given_or_lost(half: Half, joint: Target, attribute: str, size: float, rng: np.random.Generator) -> float:
    """With its sign: positive, which the model loses and the robot gains, only as far as every model has it."""
    models = [parse(s.model) for s in half.settings]
    least = min(m.number(m.joint(str(joint)), attribute, 0.0) for m in models)
    return signed(rng) * size if size <= 0.95 * least else -size


def _armature(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    inertia, _ = carried(parse(half.settings[0].model), str(target))
    size = between(0.02, 0.6, strength) * _scale(half, target, "armature", inertia, 1.5)
    return {"inertia": _given_or_lost(half, target, "armature", size, rng)}


def _coulomb(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    _, torque = carried(parse(half.settings[0].model), str(target))
    size = between(0.005, 0.12, strength) * _scale(half, target, "frictionloss", torque, 10.0)
    return {"torque": _given_or_lost(half, target, "frictionloss", size, rng)}


def _viscous(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    _, torque = carried(parse(half.settings[0].model), str(target))
    speed = max(half.speed(f"position.{target}"), 1e-3)
    size = between(0.005, 0.12, strength) * _scale(half, target, "damping", torque / speed, 8.0)
    return {"coefficient": _given_or_lost(half, target, "damping", size, rng)}


def _subtract(attribute: str) -> Callable[[Half, Target, Sizes, np.random.Generator], Half]:
    def apply(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
        (size,) = sizes.values()

        def changed(text: str) -> str:
            model = parse(text)
            joint = model.joint(str(target))
            left = model.number(joint, attribute, 0.0) - size
            if left < 0:
                raise refuse(attribute, f"joint {target} of the model has less than {size:.3g} of it to lose")
            joint.set(attribute, repr(left))
            return model.text()

        return half.with_models(changed)

    return apply


def _driven(half: Half, effect: str) -> list[tuple[str, list[ET.Element]]]:
    """(actuator, its element in every model) of the actuators that the runs command."""
    models = models_of(half, effect)
    found = [(a, [m.actuator(a) for m in models]) for a in half.actuators]
    if not found:
        raise refuse(effect, "no command was sent in them")
    return found


def _gain_targets(half: Half) -> tuple[Target, ...]:
    models = models_of(half, ACTUATOR_GAIN.name)
    for name, elements in _driven(half, ACTUATOR_GAIN.name):
        for model, element in zip(models, elements, strict=True):
            odd = [key for key in STATED_OTHERWISE if model.said(element, key) is not None]
            if element.tag not in GAIN_OF or odd:
                raise refuse(ACTUATOR_GAIN.name, f"the force of actuator {name} is not in proportion to its numbers")
    names = half.actuators
    return (None, *names) if len(names) > 1 else names


def _gain(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    return {"gain": factor(0.015, 0.7, strength, rng)}


def _change_gain(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def changed(text: str) -> str:
        model = parse(text)
        for name in half.actuators if target is None else (target,):
            _weaken(model, model.actuator(name), GAIN_OF[model.actuator(name).tag], sizes["gain"])
        return model.text()

    return half.with_models(changed)


def _weaken(model: Mjcf, element: ET.Element, attributes: tuple[tuple[str, str, int], ...], gain: float) -> None:
    for attribute, default, power in attributes:
        numbers = model.numbers(element, attribute, [float(x) for x in default.split()])
        if len(numbers):
            element.set(attribute, vector_text(numbers * gain**power))


def _stiffness_targets(half: Half) -> tuple[Target, ...]:
    models = models_of(half, POSITION_GAIN.name)
    found = []
    for name, elements in _driven(half, POSITION_GAIN.name):
        servo = all(e.tag == "position" for e in elements)
        # without damping the servo's own, a stiffness is the whole gain
        if servo and all(m.number(e, "kv", 0.0) > 0 for m, e in zip(models, elements, strict=True)):
            found.append(name)
    if not found:
        raise refuse(POSITION_GAIN.name, "no commanded actuator is a position servo with damping of its own")
    return tuple(found)


def _change_stiffness(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def changed(text: str) -> str:
        model = parse(text)
        _weaken(model, model.actuator(str(target)), (("kp", "1", -1),), sizes["gain"])
        return model.text()

    return half.with_models(changed)


ROTOR = Kind(
    ARMATURE.name, "model",
    "The joint's armature in the model changes by the inertia; the robot's stays.",
    "rotor", _joints(ARMATURE.name), _armature, _subtract("armature"),
)  # fmt: skip
DRY = Kind(
    COULOMB.name, "model",
    "The joint's frictionloss in the model changes by the torque: friction that the model is given is friction that "
    "the robot has lost by comparison.",
    "dry friction", _joints(COULOMB.name), _coulomb, _subtract("frictionloss"),
)  # fmt: skip
DAMPING = Kind(
    VISCOUS.name, "model",
    "The same with the joint's damping.",
    "damping", _joints(VISCOUS.name), _viscous, _subtract("damping"),
)  # fmt: skip
FORCE = Kind(
    ACTUATOR_GAIN.name, "model",
    "Everything that the actuator's force is proportional to is divided by the gain in the model; its limit stays, as "
    "in the library's law.",
    "gain", _gain_targets, _gain, _change_gain, factor=True,
)  # fmt: skip
STIFFNESS = Kind(
    POSITION_GAIN.name, "model",
    "The servo's position gain alone is divided by the ratio in the model; its damping and its limit stay.",
    "gain", _stiffness_targets, _gain, _change_stiffness, factor=True,
)  # fmt: skip
