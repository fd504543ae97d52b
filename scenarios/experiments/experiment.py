"""What one of the paper's learning experiments consists of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from residual_mpc.learning.stream.updates import StreamSettings
    from scenarios.experiments.setting import Setting

Build = Callable[[str, int, float], "Setting"]  # form, seed, s of the low pass


@dataclass(frozen=True)
class Experiment:
    """case, plant: as in the result. build: records the robots of a seed and learns what comes before. forms: of the
    residual; the first one is the result, the others stand beside it. labels: of the components, with their units.
    minutes: of data that the paper needed. jumps: whether the reference has spikes, to be left out of the figures."""

    name: str
    summary: str
    case: str
    plant: str
    build: Build
    settings: "StreamSettings"
    forms: tuple[str, ...]
    labels: tuple[str, str, str]
    minutes: float
    jumps: bool = False
