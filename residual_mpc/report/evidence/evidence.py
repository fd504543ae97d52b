"""What the report shows beside the diagnosis document: signals, and the gap window by window."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from residual_mpc.report.evidence.explore import Exploration
    from residual_mpc.report.evidence.run_traces import RunTraces

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Panel:
    """One channel over part of a run: several consecutive held-out windows.

    A row in which all three signals are NaN separates two windows; a NaN in one of them alone is a missing
    sample, over which its line runs on. Raises ValueError where the lengths differ or the stretch is empty.
    """

    run: str
    channel: str
    unit: str  # of the three signals
    t: Array  # (n,) s, increasing
    measured: Array  # (n,) unit
    before: Array  # (n,) unit: replayed by the nominal model
    after: Array  # (n,) unit: the same with the named effects; NaN throughout where none is named

    def __post_init__(self) -> None:
        if _one_length(self, "t", "measured", "before", "after") == 0:
            raise ValueError(f"the panel of {self.channel} in {self.run} holds no sample; leave it out")


@dataclass(frozen=True)
class Windows:
    """The gap of every window of every run. Raises ValueError where the lengths differ."""

    run: Sequence[str] = ()  # (w,) the run's name
    start: Array = field(default_factory=lambda: np.zeros(0))  # (w,) s, increasing within a run
    before: Array = field(default_factory=lambda: np.zeros(0))  # (w,) 1; NaN where the window was skipped
    after: Array = field(default_factory=lambda: np.zeros(0))  # (w,) 1; NaN where no effect is named

    def __post_init__(self) -> None:
        _one_length(self, "run", "start", "before", "after")


@dataclass(frozen=True)
class Clip:
    """The robot in one held-out window, filmed: measured, predicted and, where `after` is there, corrected motion.

    Raises ValueError where the frames are not pictures or the still is none of them.
    """

    shows: tuple[str, ...]  # why this window: "largest gap", "largest correction"
    run: str
    start: float  # s, on the log's clock
    before: float  # 1, the window's gap under the nominal model
    after: float | None  # 1, the same with the named effects; None where none is named
    frames: NDArray[np.uint8]  # (F, height, width, 3), at equal times from the window's start to its end
    still: int  # the frame that stands for all of them: where the motions are farthest apart
    seconds: float  # of the window that the frames show
    assumed: tuple[str, ...] = ()  # channels that nobody measured; the measured motion has their predicted values

    def __post_init__(self) -> None:
        if self.frames.ndim != 4 or self.frames.shape[3] != 3 or not 0 <= self.still < len(self.frames):
            raise ValueError(f"frames must be (F, height, width, 3) with still in them, got {self.frames.shape}")


@dataclass(frozen=True)
class Evidence:
    """Everything that `write_report` needs beside the diagnosis document. Each part may be empty."""

    panels: tuple[Panel, ...] = ()
    windows: Windows = field(default_factory=Windows)
    starts: Mapping[str, float] = field(default_factory=dict)  # s: each run's first stamp, from which times count
    clips: tuple[Clip, ...] = ()
    drawing: str = ""  # how the clips were drawn, or why there are none
    exploration: "Exploration | None" = None  # replays with other values of the named parameters
    traces: "tuple[RunTraces, ...]" = ()  # every run's signals, fewer samples of them than in the panels
    sliding: frozenset[str] = frozenset()  # the joints that slide


def _one_length(record: object, *names: str) -> int:
    shapes = {name: np.shape(getattr(record, name)) for name in names}
    if len(set(shapes.values())) != 1 or len(shapes[names[0]]) != 1:
        raise ValueError(f"{type(record).__name__} wants vectors of one length and got {shapes}")
    return int(shapes[names[0]][0])
