"""What the report shows beside the diagnosis document: signals, gaps window by window, and the audit's findings."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Finding(Protocol):
    """One finding of the audit, as `residual_mpc.logs.audit` makes them: any record with these fields will do."""

    @property
    def severity(self) -> str: ...  # "error", "warning" or "info"
    @property
    def kind(self) -> str: ...
    @property
    def run(self) -> str: ...  # "" where it concerns all runs
    @property
    def column(self) -> str: ...  # "" where it concerns no single column
    @property
    def message(self) -> str: ...
    @property
    def remedy(self) -> str: ...


@dataclass(frozen=True)
class Panel:
    """One channel over one stretch of a run: several consecutive windows, held out from every fit.

    A row in which all three signals are NaN parts two windows; a NaN in one of them alone is a missing sample,
    over which its line runs on. Raises ValueError where the lengths differ or the stretch is empty.
    """

    run: str
    channel: str
    unit: str  # of the three signals
    t: Array  # (n,) s, increasing
    measured: Array  # (n,) unit
    before: Array  # (n,) unit: replayed by the nominal model
    after: Array  # (n,) unit: replayed by the model with the named effects; NaN throughout where none is named

    def __post_init__(self) -> None:
        _same_length(self, "t", "measured", "before", "after")


@dataclass(frozen=True)
class WindowGaps:
    """The gap of each window of one run. Raises ValueError where the lengths differ or there is no window."""

    run: str
    start: Array  # (w,) s, increasing
    before: Array  # (w,) 1, as the gap of the whole; NaN where the window was skipped
    after: Array  # (w,) 1
    held_out: NDArray[np.bool_]  # (w,) true where no fit has seen the window

    def __post_init__(self) -> None:
        _same_length(self, "start", "before", "after", "held_out")


@dataclass(frozen=True)
class ChannelGap:
    """The gap of one channel over the held-out windows."""

    channel: str
    before: float  # 1
    after: float  # 1
    noise_floor: float  # 1


@dataclass(frozen=True)
class Evidence:
    """Everything that `write_report` needs beside the diagnosis document. Each part may be empty."""

    horizon: float  # s, the length of a window
    panels: tuple[Panel, ...] = ()
    windows: tuple[WindowGaps, ...] = ()  # one a run
    channels: tuple[ChannelGap, ...] = ()
    still: tuple[str, ...] = ()  # channels that hardly moved, and were left out
    findings: tuple[Finding, ...] = ()


def _same_length(record: object, *names: str) -> None:
    shapes = {name: np.shape(getattr(record, name)) for name in names}
    sizes = set(shapes.values())
    if len(sizes) != 1 or len(next(iter(sizes))) != 1 or next(iter(sizes))[0] == 0:
        raise ValueError(f"{type(record).__name__} wants vectors of one length, at least 1, and got {shapes}")
