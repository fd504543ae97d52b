"""What the gaps say: none beyond the noise, explained, partly explained, or unknown (contract, section 5)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from residual_mpc.diagnosis.data.gap import Gap
from residual_mpc.diagnosis.predict.noise_floor import AS_GOOD, SMALL, NoiseFloor, as_good_as_told

MOST_LEFT = 0.5**2  # of the squared gap beyond the noise floor: half of the gap
Verdict = Literal["no_gap", "effects", "partial", "unknown"]


@dataclass(frozen=True, eq=False)
class HorizonGaps:
    """The gaps over one horizon on the windows that are judged. held_out: whether no fit has seen these windows;
    steady: the gap after, in which windows that diverge count at their limit, and the `unjudged` windows after an
    unknown past not at all, unless there are no others; quantiles: of the windows' own gaps before and after, by "p50",
    "p90" and "max", and the window of the largest, by "run" and "from"."""

    horizon: float
    windows: int
    held_out: bool
    nominal: Gap
    before: Gap
    after: Gap
    steady: Gap
    floor: NoiseFloor
    quantiles: dict[str, dict[str, Any]]
    unjudged: int = 0

    @property
    def times_floor(self) -> float:
        """How many times the noise floor is left, in all or in the median window, whichever is more. A few windows in
        which the explained model magnifies every error of the start make both gaps large and hide what all others
        leave."""
        ratios = [self.steady.total / max(self.floor.total, 1e-12)]
        if self.floor.typical > 0.0:
            ratios.append(self.quantiles["after"]["p50"] / self.floor.typical)
        return max(ratios)

    @property
    def decides(self) -> bool:
        """Whether any window can be judged."""
        return self.unjudged < self.windows


def deciding(looks: Sequence[HorizonGaps]) -> list[HorizonGaps]:
    """The horizons that a verdict is about: all that can be judged, and the headline's, the first, in any case."""
    return [x for i, x in enumerate(looks) if x.decides or i == 0]


def verdict_of(looks: Sequence[HorizonGaps]) -> Verdict:
    """What the gaps say of an explanation that helps."""
    return "effects" if all(as_good_as_told(x.steady, x.floor) for x in deciding(looks)) else "partial"


def beats_forecast(look: HorizonGaps, forecast: float) -> float:
    """The share that the explained model removes of a forecast's squared gap beyond what is small or what the sensors
    can tell; 1 if no more than that is left. forecast: its gap."""
    told = max(AS_GOOD * look.floor.total, SMALL) ** 2
    left, other = look.steady.total**2 - told, forecast**2 - told
    if not left > 0.0:
        return 1.0
    return float(np.clip(1.0 - left / other, 0.0, 1.0)) if other > 0.0 else 0.0


def clearest(looks: Sequence[HorizonGaps]) -> HorizonGaps:
    """The horizon at which the gap stands most out of what noise alone hardly ever makes, which is much more where
    there are few windows."""
    return max(deciding(looks), key=lambda x: x.before.total / max(x.floor.luck, 1e-12))


def hardly_explained(look: HorizonGaps) -> bool:
    """Whether more than half of the gap beyond the floor is left, a quarter of it squared, and the gap is above twice
    the floor."""
    return look.steady.total > AS_GOOD * look.floor.total and judged_share(look) > MOST_LEFT


def judged_share(look: HorizonGaps) -> float:
    """Of the squared gap beyond the noise floor, what is left on the windows that can be judged."""
    return left_share(replace(look, after=look.steady) if look.unjudged else look)


def left_share(look: HorizonGaps) -> float:
    """Of the squared gap beyond the noise floor, what is left."""
    excess = max(look.before.total**2 - look.floor.total**2, 1e-12)
    return float(np.clip((look.after.total**2 - look.floor.total**2) / excess, 0.0, 1.0))
