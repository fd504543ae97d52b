"""The speed limits of a URDF's joints, which MuJoCo does not keep."""

import math
from xml.etree import ElementTree


def speed_limits(path: str) -> dict[str, float]:
    """Joint -> largest speed that a URDF gives it, rad/s or m/s, without those that are 0, which says nothing. Empty
    for an MJCF file, which has none, and where only MuJoCo can read the file, as with a prefix that is not declared."""
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError:
        return {}
    found: dict[str, float] = {}
    for joint in root.iter("joint") if root.tag == "robot" else ():
        limit, name = joint.find("limit"), joint.get("name")
        try:
            speed = float(limit.get("velocity", "0")) if limit is not None else 0.0
        except ValueError:
            continue
        if name is not None and 0.0 < speed < math.inf:
            found[name] = speed
    return found
