"""What a diagnosis says, as pieces of the page's text."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from benchmarks.recorded.rows import Row


def named_of(cause: dict[str, Any]) -> str:
    """`effect` on its target."""
    return f"`{cause['effect']}`" + (f" on {cause['target']}" if cause["target"] else "")


def cause_line(cause: dict[str, Any]) -> str:
    """A cause with its parameters and their intervals."""
    numbers = []
    for name, p in cause["parameters"].items():
        low, high = p["ci95"]
        unit = "" if p["unit"] == "1" else f" {p['unit']}"
        numbers.append(f"{name} {p['value']:.4g}{unit} ({low:.4g} to {high:.4g})")
    return f"{named_of(cause)}: {', '.join(numbers)}; probability {cause['probability']:.2f}"


def chain_line(stages: list[dict[str, Any]]) -> str:
    """The gap after each effect is added."""
    said = [f"{named_of(new)} {after['gap']:.3f}" for new, after in zip(steps_of(stages), stages[1:], strict=True)]
    said = [f"{stages[0]['gap']:.3f}", *said]
    return ", ".join(said)


def steps_of(stages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The effect that each stage adds to the one before."""
    return [next(t for t in after["terms"] if t not in before["terms"]) for before, after in pairwise(stages)]


def beside(cause: dict[str, Any], row: Row) -> str:
    """What is known of a cause's parameters from elsewhere, and whether the interval holds it."""
    said = []
    for name, p in cause["parameters"].items():
        true = row.true.get((cause["effect"], name))
        if true is not None:
            held = "inside" if inside(true, p["ci95"]) else "outside"
            said.append(f"; **known from elsewhere: {true:g}, {held} the interval**")
    return "".join(said)


def inside(value: float, interval: list[float]) -> bool:
    """Whether an interval holds a value."""
    return interval[0] <= value <= interval[1]


def group_line(group: list[Any]) -> str:
    """The members of a confounded group."""
    members = [member if isinstance(member, list) else [member] for member in group]
    return ", ".join(" with ".join(named_of(part) for part in member) for member in members)


def held_out(kept: list[Any]) -> str:
    """Names of runs, or how many stretches."""
    names = [k for k in kept if isinstance(k, str)]
    if not names:
        return f"{len(kept)} stretches of the runs"
    return ", ".join(names) if len(names) <= 8 else f"{len(names)} runs, such as {', '.join(names[:3])}"
