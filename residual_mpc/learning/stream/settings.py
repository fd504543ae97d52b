"""How a residual is learned from a stream of velocities."""

from dataclasses import dataclass

from residual_mpc.learning.filter.kalman import FilterSettings
from residual_mpc.learning.network.mlp import PAPER_HIDDEN


@dataclass(frozen=True)
class StreamSettings:
    """horizon: N, samples in an update; stride: new samples from one update to the next (None: N, as in the paper's
    learning law, which counts each sample once).

    watch: s of data that are looked at, for scales alone, before the first update. variance: of each weight before any
    data. goal: share of each component's error of late that an update does not try to explain: it stands in C_v, beside
    `noise` (m/s or rad/s, one a component, or one for all), for what such a network cannot follow. memory: updates in
    which an old error is forgotten. replays: updates on windows from before, drawn from the last `kept`, beside each on
    a new one: an update takes a millisecond, new samples much longer to come; 0: the paper's law, literally. low_pass:
    s, the time constant of the paper's filter on the network's output, 0 for none. costs: the paper's C, one a
    component; None: 1 each. halvings: of an update that makes its own window worse. method: "ukf" or "ekf".
    """

    hidden: tuple[int, ...] = PAPER_HIDDEN
    horizon: int = 20
    stride: int | None = None
    watch: float = 2.0
    variance: float = 0.1
    goal: float = 0.5
    noise: tuple[float, ...] = (0.0,)
    memory: float = 10.0
    replays: int = 10
    kept: int = 100
    low_pass: float = 0.0
    costs: tuple[float, ...] | None = None
    kalman: FilterSettings = FilterSettings(process=1e-6)
    halvings: int = 3
    method: str = "ukf"

    def __post_init__(self) -> None:
        stride = self.horizon if self.stride is None else self.stride
        if self.horizon < 2 or not 1 <= stride <= self.horizon or not self.variance > 0 or not 0 <= self.goal < 1:
            raise ValueError(f"horizon must be >= 2, stride <= horizon, variances > 0 and the goal < 1, got {self}")
        if self.costs is not None and not min(self.costs) > 0:
            raise ValueError(f"costs must be > 0, got {self.costs}")
        if self.method not in ("ukf", "ekf"):
            raise ValueError(f"method must be ukf or ekf, got {self.method!r}")

    @property
    def new(self) -> int:
        """Samples from one update to the next."""
        return self.horizon if self.stride is None else self.stride
