"""Changes of masses and lengths, put into the model: what the model lacks, the robot has gained."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from residual_mpc.blind.recorded.chain import lifted, moving, moving_mass, next_link
from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.inertial import inertial_of, with_point_mass, write_inertial
from residual_mpc.blind.recorded.kinds.kind import Kind, Sizes, Target, between, refuse, signed
from residual_mpc.blind.recorded.mjcf import Mjcf, Vector, parse, place, vector_text
from residual_mpc.effects.body import LINK_LENGTH, LINK_MASS, PAYLOAD
from residual_mpc.errors import BadInput


def models_of(half: Half, effect: str) -> list[Mjcf]:
    """The models of all settings, parsed; `BadInput` where the robot has none."""
    if any(not s.model for s in half.settings):
        raise refuse(effect, "the robot has no MJCF file")
    return [parse(s.model) for s in half.settings]


def _site(half: Half, model: Mjcf) -> ET.Element:
    """Where the payload sits."""
    if half.payload_site is not None:
        return model.site(half.payload_site)
    last = list(model.bodies())[-1].findall("site")
    if not last:
        raise refuse(PAYLOAD.name, "the robot file names no payload_site, and the last body has no site")
    return last[-1]


def _payload_targets(half: Half) -> tuple[Target, ...]:
    for model in models_of(half, PAYLOAD.name):
        inertial_of(model, model.parents[_site(half, model)])
    return (None,)


def _payload(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    models = models_of(half, PAYLOAD.name)
    mass = between(0.01, 0.35, strength) * moving_mass(models[0])
    sign = signed(rng)
    if sign > 0 and not all(_can_lack(m, m.parents[_site(half, m)], mass, place(_site(half, m))) for m in models):
        sign = -1.0  # the model cannot lack it, so it is given it and the robot loses it
    return {"mass": sign * mass}


def _can_lack(model: Mjcf, body: ET.Element, mass: float, at: Vector) -> bool:
    try:
        with_point_mass(inertial_of(model, body), -mass, at)
    except BadInput:
        return False
    return True


def _change_payload(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def changed(text: str) -> str:
        model = parse(text)
        site = _site(half, model)
        body = model.parents[site]
        write_inertial(body, with_point_mass(inertial_of(model, body), -sizes["mass"], place(site)))
        return model.text()

    return half.with_models(changed)


def _mass_targets(half: Half) -> tuple[Target, ...]:
    model = models_of(half, LINK_MASS.name)[0]
    for body in moving(model):
        inertial_of(model, body)
    return tuple(str(body.get("name")) for body in lifted(model) if body.get("name"))


def _link_mass(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    model = models_of(half, LINK_MASS.name)[0]
    own = inertial_of(model, model.body(str(target))).mass
    mass = between(0.01, 0.35, strength) * moving_mass(model)
    sign = signed(rng) if mass < 0.8 * own else -1.0
    return {"mass": sign * mass}


def _change_mass(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def changed(text: str) -> str:
        model = parse(text)
        body = model.body(str(target))
        own = inertial_of(model, body)
        write_inertial(body, with_point_mass(own, -sizes["mass"], own.centre))
        return model.text()

    return half.with_models(changed)


def _length_targets(half: Half) -> tuple[Target, ...]:
    model = models_of(half, LINK_LENGTH.name)[0]
    found = tuple(str(b.get("name")) for b in model.bodies() if b.get("name") and next_link(model, b) is not None)
    if not found:
        raise refuse(LINK_LENGTH.name, "no link of the model holds exactly one next joint at a distance")
    return found


def _length(half: Half, target: Target, strength: float, rng: np.random.Generator) -> Sizes:
    model = models_of(half, LINK_LENGTH.name)[0]
    after = next_link(model, model.body(str(target)))
    assert after is not None
    return {"offset": signed(rng) * between(0.02, 0.35, strength) * float(np.linalg.norm(place(after)))}


def _change_length(half: Half, target: Target, sizes: Sizes, rng: np.random.Generator) -> Half:
    def changed(text: str) -> str:
        model = parse(text)
        after = next_link(model, model.body(str(target)))
        assert after is not None
        line = place(after)
        after.set("pos", vector_text(line * (1.0 - sizes["offset"] / np.linalg.norm(line))))
        return model.text()

    return half.with_models(changed)


CARRIED = Kind(
    PAYLOAD.name, "model",
    "The model's body loses a point mass at the payload site, with its share of the centre and of the inertia: the "
    "robot has it, and has gained it by comparison. A model that gains one makes the robot lose it.",
    "mass", _payload_targets, _payload, _change_payload,
)  # fmt: skip
LINK = Kind(
    LINK_MASS.name, "model",
    "The same at the link's own centre of mass, where a point mass changes neither the centre nor the inertia about "
    "it.",
    "mass", _mass_targets, _link_mass, _change_mass,
)  # fmt: skip
LENGTH = Kind(
    LINK_LENGTH.name, "model",
    "The model's next joint is moved back along the line between the two joints; masses and inertias keep their place "
    "on their links.",
    "length", _length_targets, _length, _change_length,
)  # fmt: skip
