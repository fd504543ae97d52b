"""Settings of `watch`."""

from dataclasses import dataclass, field

from residual_mpc.diagnosis.checks import check_positive, check_share


@dataclass(frozen=True)
class ArrivalSettings:
    """poll: s between two looks at the logs. most: bytes of text that are read at once. header_rows: rows that a new
    log may have before it must be readable (an actuator may wait for its first command). pause: s and
    pause_periods: sampling periods, the larger of which without a row ends a segment; back: s by which stamps may fall
    back before a new segment begins. kept: s of the stream that stay in memory. open: files that are followed at
    once, the oldest of which are closed first."""

    poll: float = 0.25
    most: int = 4 << 20
    header_rows: int = 2000
    pause: float = 1.0
    pause_periods: float = 5.0
    back: float = 10.0
    kept: float = 900.0
    open: int = 8

    def __post_init__(self) -> None:
        check_positive(self, "poll", "most", "header_rows", "pause", "pause_periods", "back", "kept", "open")


@dataclass(frozen=True)
class DetectionSettings:
    """The sequential test.

    hours: h of steady running over which a false alarm has at most the probability `false_alarm`; draws: of a
    reference and a stream of that length, from which the thresholds follow; tail: degrees of freedom of their blocks'
    distribution. neighbours: share of the reference's windows that a window is ranked among, at least
    `fewest_neighbours` and at most `most_neighbours` of them; components: principal components of the driving that
    neighbours are close in and errors are regressed on; ridge: of that regression, in windows; familiar: times the
    reference's own distances beyond which a window has no neighbours. allowances: of the cumulative sums, in standard
    deviations of a block's mean; clip: of one block, likewise. blocks: lengths of a block in windows, of which the
    first is taken whose means are correlated less than `correlated` from one to the next, with at least
    `fewest_blocks` in the reference; persistence: the largest correlation that the thresholds allow for. whole: share
    of a channel's usual samples that a window must have. large: the part of `false_alarm` for errors of the last
    `large_windows` windows that are far above the reference's; large_known: share of these windows that need a value.
    """

    hours: float = 100.0
    false_alarm: float = 0.2
    draws: int = 400
    tail: float = 6.0
    neighbours: float = 0.15
    fewest_neighbours: int = 20
    most_neighbours: int = 80
    components: int = 3
    ridge: float = 3.0
    familiar: float = 1.5
    allowances: tuple[float, ...] = (0.5, 1.0, 2.0)
    clip: float = 4.0
    blocks: tuple[int, ...] = (15, 30, 60)
    fewest_blocks: int = 10
    correlated: float = 0.2
    persistence: float = 0.6
    whole: float = 0.7
    large: float = 0.02
    large_windows: int = 12
    large_known: float = 0.8

    def __post_init__(self) -> None:
        check_positive(self, "hours", "draws", "fewest_neighbours", "most_neighbours", "components", "ridge",
                       "familiar", "clip", "fewest_blocks", "large_windows")  # fmt: skip
        check_share(self, "false_alarm", "neighbours", "correlated", "persistence", "whole", "large", "large_known")
        if self.large >= self.false_alarm:
            raise ValueError(
                f"DetectionSettings.large must be less than false_alarm, got {self.large} and {self.false_alarm}"
            )
        if self.tail <= 2.0:
            raise ValueError(f"DetectionSettings.tail must be > 2, got {self.tail}")


@dataclass(frozen=True)
class WatchSettings:
    """learn: s of the stream that serve as the reference where there is no other; every: s of the stream between two
    figures; attempts: s of the stream since a change after which its cause is looked for."""

    learn: float = 600.0
    every: float = 10.0
    attempts: tuple[float, ...] = (30.0, 90.0, 240.0)
    arrivals: ArrivalSettings = field(default_factory=ArrivalSettings)
    detection: DetectionSettings = field(default_factory=DetectionSettings)

    def __post_init__(self) -> None:
        check_positive(self, "learn", "every")
