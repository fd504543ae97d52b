"""Mass, centre and inertia of a body of an MJCF file, and what is left of them without a point mass."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from residual_mpc.blind.recorded.mjcf import Mjcf, Vector, place, turned, vector_text
from residual_mpc.errors import BadInput


@dataclass(frozen=True)
class Inertial:
    """mass: kg; centre: (3,) m in the body's frame; about: (3, 3) kg m^2 about the centre, along the frame's axes."""

    mass: float
    centre: Vector
    about: Vector


def inertial_of(model: Mjcf, body: ET.Element) -> Inertial:
    """What the file says of a body: an <inertial>, or one sphere with a mass; `BadInput` where it says it otherwise."""
    name = body.get("name", "")
    compiler = {key: c.get(key) for c in model.root.findall("compiler") for key in c.attrib}
    stated = body.find("inertial")
    if compiler.get("inertiafromgeom") == "true" or "settotalmass" in compiler:
        raise BadInput(f"the compiler computes the mass of body {name!r}", "--robot", "give it an <inertial>")
    if stated is not None:
        return _stated(stated)
    geoms = body.findall("geom")
    if len(geoms) == 1 and geoms[0].get("type") == "sphere" and "mass" in geoms[0].attrib:
        mass, radius = float(geoms[0].attrib["mass"]), float(geoms[0].attrib["size"].split()[0])
        return Inertial(mass, place(geoms[0]), 0.4 * mass * radius**2 * np.eye(3))
    raise BadInput(f"body {name!r} has no <inertial> in the file", "--robot", "save the model with MuJoCo first")


def _stated(stated: ET.Element) -> Inertial:
    mass, centre = float(stated.attrib["mass"]), place(stated)
    if "fullinertia" in stated.attrib:
        xx, yy, zz, xy, xz, yz = (float(x) for x in stated.attrib["fullinertia"].split())
        return Inertial(mass, centre, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    moments = np.diag([float(x) for x in stated.get("diaginertia", "0 0 0").split()])
    turn = turned(stated)
    return Inertial(mass, centre, turn @ moments @ turn.T)


def with_point_mass(body: Inertial, mass: float, at: Vector) -> Inertial:
    """The body with a point mass (kg, negative: without it) at ``at``; `BadInput` where none such could exist."""
    total = body.mass + mass
    if total <= 0.05 * body.mass:
        raise BadInput(f"a body of {body.mass:.3g} kg cannot lack {-mass:.3g} kg", "--kind")
    centre = (body.mass * body.centre + mass * at) / total
    about = body.about + _steiner(body.mass, body.centre - centre) + _steiner(mass, at - centre)
    moments = np.linalg.eigvalsh(about)
    if moments[0] <= 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        raise BadInput(f"no body lacks {-mass:.3g} kg there: its inertia would not be that of any mass", "--kind")
    return Inertial(total, centre, about)


def _steiner(mass: float, r: Vector) -> Vector:
    """The inertia of a point mass at r: mass (|r|^2 I - r r')."""
    return np.asarray(mass * (r @ r * np.eye(3) - np.outer(r, r)))


def write_inertial(body: ET.Element, new: Inertial) -> None:
    """Put ``new`` in the place of what gave the body its mass. A body whose geoms did keeps their shapes."""
    for old in body.findall("inertial"):
        body.remove(old)
    for geom in body.findall("geom"):
        if "mass" in geom.attrib:
            geom.set("mass", "0")
    m = new.about
    element = ET.Element("inertial", {
        "pos": vector_text(new.centre), "mass": repr(float(new.mass)),
        "fullinertia": vector_text([m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]]),
    })  # fmt: skip
    body.insert(0, element)
