"""An MJCF file as XML: what its elements say, defaults of their classes included."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from residual_mpc.errors import BadInput

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Mjcf:
    """A parsed model; ``root`` is this record's own and may be edited before it is written."""

    root: ET.Element
    parents: Mapping[ET.Element, ET.Element]

    def text(self) -> str:
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def bodies(self) -> Iterator[ET.Element]:
        """Bodies in the order of the file."""
        for world in self.root.iter("worldbody"):
            yield from world.iter("body")

    def body(self, name: str) -> ET.Element:
        return self._named(self.bodies(), name, "body")

    def joint(self, name: str) -> ET.Element:
        return self._named((j for b in self.bodies() for j in b.findall("joint")), name, "joint")

    def actuator(self, name: str) -> ET.Element:
        return self._named((a for group in self.root.iter("actuator") for a in group), name, "actuator")

    def site(self, name: str) -> ET.Element:
        return self._named((s for b in self.bodies() for s in b.findall("site")), name, "site in a body")

    def number(self, element: ET.Element, attribute: str, default: float) -> float:
        """An attribute of the element, of its class, or ``default``."""
        return float(self.numbers(element, attribute, (default,))[0])

    def numbers(self, element: ET.Element, attribute: str, default: Sequence[float]) -> Vector:
        text = self.said(element, attribute)
        return np.array([float(x) for x in text.split()] if text else default, dtype=np.float64)

    def said(self, element: ET.Element, attribute: str) -> str | None:
        """The text of an attribute, of the element or of the classes that it belongs to; None where none sets it."""
        if attribute in element.attrib:
            return element.attrib[attribute]
        for section in self._classes(element):
            for setting in section.findall(element.tag):
                if attribute in setting.attrib:
                    return setting.attrib[attribute]
        return None

    def _classes(self, element: ET.Element) -> Iterator[ET.Element]:
        """The default sections of an element, the nearest first."""
        name = element.get("class")
        above = self.parents.get(element)
        while name is None and above is not None:
            name = above.get("childclass")
            above = self.parents.get(above)
        tops = self.root.findall("default")
        every = [section for top in tops for section in top.iter("default")]
        section = next((s for s in every if name is not None and s.get("class") == name), None)
        while section is not None and section not in tops:
            yield section
            section = self.parents[section]
        yield from tops

    def _named(self, elements: Iterator[ET.Element], name: str, what: str) -> ET.Element:
        found = next((e for e in elements if e.get("name") == name), None)
        if found is None:
            raise BadInput(f"the model has no {what} named {name!r}", "--kind", "name it in the model's file")
        return found


def parse(text: str) -> Mjcf:
    """The model in ``text``; `BadInput` where its masses and defaults cannot be read off the file."""
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise BadInput(f"the model is not valid XML ({error})", "--robot") from None
    if root.tag != "mujoco":
        raise BadInput(f"the model must be MJCF, got <{root.tag}>", "--robot", "convert it with MuJoCo first")
    if root.find(".//include") is not None:
        raise BadInput("the model includes other files", "--robot", "save it as one file with MuJoCo first")
    return Mjcf(root, {child: parent for parent in root.iter() for child in parent})


def vector_text(values: Sequence[float] | Vector) -> str:
    """Numbers as MJCF writes them, to the last digit."""
    return " ".join(repr(float(v)) for v in values)


def place(element: ET.Element) -> Vector:
    """The element's position in its parent's frame, m."""
    return np.array([float(x) for x in element.get("pos", "0 0 0").split()])


def turned(element: ET.Element) -> Vector:
    """Rotation (3, 3) from the element's frame to its parent's; `BadInput` where it is given otherwise than by a
    quaternion."""
    if any(key in element.attrib for key in ("axisangle", "xyaxes", "zaxis", "euler")):
        raise BadInput(
            f"element {element.get('name', element.tag)!r} is turned otherwise than by a quaternion", "--robot",
            "save the model with MuJoCo first",
        )  # fmt: skip
    w, x, y, z = (float(q) for q in element.get("quat", "1 0 0 0").split())
    turn = np.array([
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ])  # fmt: skip
    return np.asarray(turn / (w * w + x * x + y * y + z * z))
