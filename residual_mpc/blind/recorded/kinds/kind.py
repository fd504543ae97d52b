"""What a kind of change is: where it can be put, how large, and why it is exact."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from residual_mpc.blind.recorded.half import Half
from residual_mpc.errors import BadInput

Sizes = Mapping[str, float]  # parameter -> how much it changes: a difference, or a ratio of gains, scales and radii
Target = str | None


@dataclass(frozen=True)
class Kind:
    """One kind of change.

    Attributes:
        effect: by which the change is named.
        place: what is edited.
        why: why the edited half is what the robot with this change would have logged.
        family: a case has one change of a family at most, since two would be mistaken for each other.
        targets: where the change can act on this half; `BadInput` where it cannot be put in exactly.
        size: draws sizes for one target. The strength runs from 0, barely visible, to 1, large.
        apply: puts the change in.
        rank: changes of a lower rank are put in first.
        directed: whether it shifts measurements or predictions in one direction, so that it has a visibility;
            outliers do not.
        factor: whether it multiplies a number of the model, of which the nominal value may be far from the robot's.
    """

    effect: str
    place: Literal["log", "model"]
    why: str
    family: str
    targets: Callable[[Half], tuple[Target, ...]]
    size: Callable[[Half, Target, float, np.random.Generator], Sizes]
    apply: Callable[[Half, Target, Sizes, np.random.Generator], Half]
    rank: int = 0
    directed: bool = True
    factor: bool = False


def refuse(effect: str, why: str, remedy: str = "choose another kind") -> BadInput:
    """The message for a half that cannot carry a change."""
    return BadInput(f"{effect} cannot be put into these runs exactly: {why}", "--kind", remedy)


def between(low: float, high: float, strength: float) -> float:
    """From low to high in equal ratios as the strength goes from 0 to 1."""
    return float(low * (high / low) ** strength)


def signed(rng: np.random.Generator) -> float:
    """1 or -1."""
    return float(rng.choice((-1.0, 1.0)))


def factor(low: float, high: float, strength: float, rng: np.random.Generator) -> float:
    """A ratio above or below 1 whose logarithm is between low and high."""
    return float(np.exp(signed(rng) * between(low, high, strength)))
