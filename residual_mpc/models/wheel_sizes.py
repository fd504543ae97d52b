"""Sizes of a robot on wheels that are hardly meant in metres."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from residual_mpc.logs.finding import Finding
from residual_mpc.models.robot_file import WHEELS, RobotFile, for_run

LARGEST = dict(zip(WHEELS, (2.0, 20.0), strict=True))  # m, above those of any robot on wheels
NARROWEST = 0.2  # of the wheels' radius, below the track of any robot on wheels


def implausible_sizes(robot: RobotFile, run_names: Sequence[str]) -> list[Finding]:
    """A warning for each size in the robot file, or in a variant of these runs, that is probably in another unit."""
    files = (robot, *(for_run(robot, name) for name in run_names))
    return list(dict.fromkeys(finding for file in files for finding in _of(file)))


def _of(file: RobotFile) -> Iterator[Finding]:
    sizes = {name: file.parameters[name] for name in WHEELS if name in file.parameters}
    large = [name for name, size in sizes.items() if size > LARGEST[name]]
    for name in large:
        yield _warning(f"{name} is {sizes[name]:g} m, more than {LARGEST[name]:g} m")
    if large or len(sizes) < len(WHEELS):
        return
    radius, track = (sizes[name] for name in WHEELS)
    if track < NARROWEST * radius:
        yield _warning(f"{WHEELS[1]} is {track:g} m, less than {NARROWEST:g} times {WHEELS[0]}, {radius:g} m")


def _warning(message: str) -> Finding:
    remedy = "metres are expected under [parameters] in the robot file"
    return Finding("warning", "implausible size", "", "", None, message, remedy)
