"""Where a file of a ROS package lies: `package://NAME/meshes/part.stl`."""

import os
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

SCHEMES = ("package://", "model://", "file://")
DEPTH = 3  # folders below an entry of ROS_PACKAGE_PATH that are searched for packages


def places_of(name: str, home: Path) -> Iterator[Path]:
    """Where the file of a URI may be, the likeliest first; none where the name has no scheme.

    home: absolute folder of the model. A package is known by its package.xml or by the name of its folder. It is looked
    for in and above the model's folder, in AMENT_PREFIX_PATH (ROS 2) and in ROS_PACKAGE_PATH.
    """
    scheme = next((s for s in SCHEMES if name.startswith(s)), "")
    if not scheme:
        return
    rest = name.removeprefix(scheme)
    package, _, inside = rest.lstrip("/").partition("/")
    yield Path(rest if rest.startswith("/") else f"/{rest}")
    for folder in (home, *home.parents):
        if _name_of(folder) == package:
            yield folder / inside
        yield folder / rest.lstrip("/")
        yield folder / inside
    for prefix in _entries("AMENT_PREFIX_PATH"):
        yield prefix / "share" / package / inside
    for entry in _entries("ROS_PACKAGE_PATH"):
        for folder in (entry, *_packages_below(entry)):
            if package in (folder.name, _name_of(folder)):
                yield folder / inside


def _entries(variable: str) -> list[Path]:
    return [Path(p) for p in os.environ.get(variable, "").split(os.pathsep) if p]


def _packages_below(folder: Path) -> Iterator[Path]:
    for depth in range(1, DEPTH + 1):
        for found in sorted(folder.glob("/".join(["*"] * depth) + "/package.xml")):
            yield found.parent


def _name_of(folder: Path) -> str | None:
    """The name in the folder's package.xml, None without a readable one."""
    try:
        name = ElementTree.parse(folder / "package.xml").getroot().findtext("name")
    except (OSError, ElementTree.ParseError):
        return None
    return name.strip() if name else None
