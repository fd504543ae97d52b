"""The column names of a run table, as the log format defines them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

PLANAR = ("x", "y", "theta")
QUATERNION = ("qx", "qy", "qz", "qw")  # of a pose, from which its theta is computed
PER_ACTUATOR = ("command", "enabled")
PER_JOINT = ("position", "velocity", "effort")
PER_BODY = ("pose", "twist")
GROUPS = PER_ACTUATOR + PER_JOINT + PER_BODY
SPECIAL = ("t", "run")
TIMES = ("timestamp", "time", "stamp", "clock", "seconds", "secs", "sec", "t")  # the likeliest first
RUNS = frozenset("run runs episode episodes trial trials rollout rollouts experiment trajectory traj".split())


def group(name: str) -> str | None:
    """The group of a recognised data column (`command.left` -> `command`), or None for any other name."""
    head, dot, tail = name.partition(".")
    if not dot or not tail or head not in GROUPS:
        return None
    if head in PER_BODY and tail not in PLANAR and not (head == "pose" and tail in QUATERNION):
        return None
    return head


def member(name: str) -> str:
    """The actuator, joint or axis of a recognised data column (`command.left` -> `left`)."""
    return name.partition(".")[2]


def is_measured(name: str) -> bool:
    """Whether a name stands for something that the robot's sensors or its localisation reported."""
    return group(name) in PER_JOINT + PER_BODY


def within_topic(column: str) -> str:
    """A recording's column without its topic (`/joint_states.velocity.left` -> `velocity.left`); others as they are."""
    return column.partition(".")[2] if column.startswith("/") else column


def likely_time(names: Iterable[str]) -> str | None:
    """The column whose name is most like that of a time, or None."""
    words = {name: _words(name) for name in names}
    return next((name for time in TIMES for name in words if time in words[name]), None)


def likely_run(names: Iterable[str]) -> str | None:
    """The first column whose name is like that of a run, or None."""
    return next((name for name in names if _words(name) & RUNS), None)


def _words(name: str) -> set[str]:
    return set(re.findall("[a-z]+", name.lower()))


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A remedy that names the nearest known word, or the known words where none is near."""
    words = list(known)
    near = difflib.get_close_matches(name, words, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    if not words:
        return "no other column is unassigned"
    return "known here: " + ", ".join(words[:40]) + (", ..." if len(words) > 40 else "")
