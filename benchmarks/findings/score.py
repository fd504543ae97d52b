"""Whether a diagnosis is right: the set of effects, up to reported groups that hold the true one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

LARGEST_GROUP = 3
STATED = 0.5  # a wrong effect at this probability or above is stated, not doubted
NO_GAP_LEVELS = ("none", "rough_none")
UNNAMED_LEVELS = ("changed", "unknown")
ADMITS = ("partial", "unknown")
LAWS = ("fitted_law",)  # a law fitted to the rest claims no name
# Twins that no data of some kind can part: groups of these may be larger.
TWINS = (
    {"wheel_radius", "actuator_gain", "wheel_radius_mismatch"},
    {"command_delay", "sensor_delay"},
    {"wheel_radius", "longitudinal_slip", "slope"},
    {"coulomb_friction", "stribeck_friction"},
    {"payload", "link_mass"},
)


Reading = frozenset[tuple[str, str | None]]  # (effect, target)


@dataclass(frozen=True)
class Score:
    """`mark` is right, wrong or doubted; `targets` None where they do not count; the rest describes wrong effects."""

    mark: str
    targets: bool | None
    highest_wrong: float  # probability, 0 where no wrong effect is named
    extras: int
    why: str = ""


def score(document: Mapping[str, Any], truth: Mapping[str, Any], closed: float | None = None) -> Score:
    """Mark diagnosis.json against truth.json; `closed` is the share of the gap closed on motions not seen."""
    planted, background = truth["planted"], truth.get("background") or {}
    named = document["explanation"]
    reading = best_reading(named, document["confounded"], set(planted), set(background))
    names = {effect for effect, _ in reading}
    fine = {*planted, *background, *LAWS} - set(truth.get("forbidden", ()))
    wrong = [c for c, name in zip(named, read_as(named, reading), strict=True) if name not in fine]
    if truth.get("closes") is not None:  # nobody knows the causes
        wrong = []
    highest = max((c["probability"] for c in wrong), default=0.0)
    right, why = verdict_of(document, truth, names, bool(wrong), closed)
    stated = max((c["probability"] for c in [*wrong, *values_off(named, truth)]), default=0.0)
    mark = "right" if right else "doubted" if doubts(document, truth, stated) else "wrong"
    aim = targets_right(named, planted) if right and planted and names == {c["effect"] for c in named} else None
    return Score(mark, aim, highest, len(wrong), why)


def verdict_of(
    document: Mapping[str, Any], truth: Mapping[str, Any], names: set[str], wrong: bool, closed: float | None
) -> tuple[bool, str]:
    """Whether the answer is right, and why not."""
    level, verdict = truth["level"], document["verdict"]
    if level in NO_GAP_LEVELS:
        return verdict == "no_gap", ""
    absurd = sorted({c["effect"] for c in document["explanation"]} & set(truth.get("forbidden", ())))
    if absurd:
        return False, f"{', '.join(absurd)} cannot be at work"
    if level in UNNAMED_LEVELS:
        return verdict in ADMITS, ""
    if truth.get("closes") is not None:
        return closed is not None and closed >= truth["closes"], f"wanted {truth['closes']:.0%} closed"
    missed = sorted(set(truth["planted"]) - names)
    admitted = bool(truth.get("lacking")) and verdict in ADMITS
    if wrong or (missed and not admitted):
        return False, f"missed {', '.join(missed)}" if missed else ""
    off = sorted({c["effect"] for c in values_off(document["explanation"], truth)})
    return not off, f"value of {', '.join(off)}" if off else ""


def doubts(document: Mapping[str, Any], truth: Mapping[str, Any], stated: float) -> bool:
    """A wrong answer that says so itself: the verdict admits a rest, and no wrong effect or value is stated."""
    return truth["level"] not in NO_GAP_LEVELS and document["verdict"] in ADMITS and stated < STATED


def best_reading(named: Sequence[Any], groups: Sequence[Any], planted: set[str], background: set[str]) -> Reading:
    """What is named, with members of reported groups exchanged so that it is nearest to what was planted."""
    base = parts_of(list(named))
    choices: list[list[tuple[Reading, Reading]]] = []
    for group in groups:
        members = [parts_of(member) for member in group]
        held = next((m for m in members if m <= base), None)
        if held is not None and (len(members) <= LARGEST_GROUP or twins(members)):
            choices.append([(held, m) for m in members])

    def distance(reading: Reading) -> tuple[int, bool]:
        names = {effect for effect, _ in reading}
        return len(planted - names) + len(names - planted - background), reading != base

    readings: list[Reading] = [exchanged(base, swaps) for swaps in product(*choices)]
    nearest = min(readings, key=distance)
    return nearest


def exchanged(base: Reading, swaps: Iterable[tuple[Reading, Reading]]) -> Reading:
    """`base` with each first of `swaps` replaced by its second."""
    for out, into in swaps:
        base = (base - out) | into
    return base


def parts_of(member: Any) -> Reading:
    """Effect and target of each part of a group's member, which is one effect or a list of them."""
    return frozenset((p["effect"], p["target"]) for p in (member if isinstance(member, list) else [member]))


def twins(members: Sequence[Reading]) -> bool:
    """Whether a group holds nothing but twins."""
    every = {effect for member in members for effect, _ in member}
    return any(every <= pair for pair in TWINS)


def read_as(named: Sequence[Any], reading: Reading) -> list[str]:
    """The name of each effect in the best reading: its own, or, where it was exchanged, another one's."""
    free = sorted(effect for effect, _ in reading - parts_of(list(named)))
    return [free[0] if free and (c["effect"], c["target"]) not in reading else c["effect"] for c in named]


def plants(entry: Any) -> list[Mapping[str, Any]]:
    """An effect's entries in truth.json: one, or a list for several targets."""
    return list(entry) if isinstance(entry, list) else [entry]


def targets_right(named: Sequence[Any], planted: Mapping[str, Any]) -> bool:
    """Whether every planted effect is named at its targets; null stands for all of them."""
    for effect, entry in planted.items():
        true = {joint_of(p.get("target")) for p in plants(entry)}
        said = {joint_of(c["target"]) for c in named if c["effect"] == effect}
        if said != true and said != {None} and true != {None}:
            return False
    return True


def joint_of(target: str | None) -> str | None:
    """A target without its channel's kind; an actuator m2 is read as its joint j2, `pose` as the robot."""
    if target is None or target == "pose" or target.startswith("pose."):
        return None
    return re.sub(r"^m(\d+)$", r"j\1", target.split(".")[-1])


def values_off(named: Sequence[Any], truth: Mapping[str, Any]) -> list[Any]:
    """Causes whose first parameter is further from the truth than the factor `within`."""
    factor = truth.get("within")
    if factor is None:
        return []
    every = {**(truth.get("background") or {}), **truth["planted"]}
    return [c for c in named if c["effect"] in every and not near(c, plants(every[c["effect"]]), factor)]


def near(cause: Mapping[str, Any], entries: Sequence[Mapping[str, Any]], factor: float) -> bool:
    """Whether the value lies within the factor of the target's true one, or of the mean where it has no target."""
    mine = [e for e in entries if joint_of(e.get("target")) == joint_of(cause["target"])] or list(entries)
    parameter = next((p for p in cause["parameters"] if p in mine[0]), None)
    if parameter is None:
        return True
    value, true = cause["parameters"][parameter]["value"], float(np.mean([e[parameter] for e in mine]))
    return bool(value * true > 0 and max(value / true, true / value) <= factor)
