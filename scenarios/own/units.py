"""Units of tracking errors."""

from collections.abc import Collection, Sequence

from scenarios.own.reference import is_of_the_tool


def unit_of(names: Sequence[str], sliding: Collection[str]) -> str:
    """The unit of the tracking error of these channels; sliding: the joints that slide."""
    metres = is_of_the_tool(tuple(names)) or not {"pose.x", "pose.y"}.isdisjoint(names)
    return "m" if metres or set(names) <= {f"position.{joint}" for joint in sliding} else "rad"


def mixed(names: Sequence[str], sliding: Collection[str]) -> list[str]:
    """What has to be said of an error in which metres stand beside radians; empty where none do."""
    slides = [joint for joint in sliding if f"position.{joint}" in names]
    if not slides or unit_of(names, sliding) == "m":
        return []
    return [f"the tracking error counts a metre of {', '.join(slides)} like a radian"]
