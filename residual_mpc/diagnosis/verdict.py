"""What the gaps say: none beyond the noise, explained, partly explained, or unknown (contract, section 5)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from residual_mpc.diagnosis.dataset import Dataset
from residual_mpc.diagnosis.floor import noise_errors
from residual_mpc.diagnosis.gap import Gap, Scales, gap_of
from residual_mpc.diagnosis.records import Verdict
from residual_mpc.diagnosis.thinning import evenly
from residual_mpc.models.settings import Settings

LUCK = 5e-4  # probability that the noise of a perfect model exceeds what chance is allowed
FEW = 5.0  # windows at which these margins double: where there are few, the noise itself is poorly known
PER_WINDOW = 4.0  # most degrees of freedom that a window's squared error counts as
MARGIN = 1.25  # a gap within this factor of the noise floor is none
CHANNEL_MARGIN = 1.4  # likewise in one channel, of which there are several, each with less to average
AS_GOOD = 2.0  # times the noise floor: as good as these sensors can tell
SMALL = 0.05  # of the motion: small enough, whatever the noise
DRAWS = 8
STEPS = 40_000  # simulation steps that one draw may cost


@dataclass(frozen=True, eq=False)
class Floor:
    """The gap of a perfect model under the sensors' noise: its total and channels (C,), and what noise alone hardly
    ever exceeds; windows: from how many."""

    total: float
    channels: np.ndarray
    luck: float
    channel_luck: np.ndarray
    windows: int


@dataclass(frozen=True, eq=False)
class AtHorizon:
    """The gaps over one horizon on the windows that are judged. held_out: whether no fit has seen these windows;
    steady: the gap after, in which windows that diverge count at their limit; quantiles: of the windows' own gaps
    before and after, by "p50", "p90" and "max"."""

    horizon: float
    windows: int
    held_out: bool
    nominal: Gap
    before: Gap
    after: Gap
    steady: Gap
    floor: Floor
    quantiles: dict[str, dict[str, float]]


def floor_of(
    data: Dataset, scales: Scales, row: Settings, rng: np.random.Generator, draws: int = DRAWS, steps: int = STEPS
) -> Floor:
    """The noise floor of the model `row` on these windows (of very many, evenly chosen ones), with the data's noise."""
    keep = evenly(data, steps)
    some = data if keep.all() else data.take(keep)
    return floor_from([gap_of(some, scales, e) for e in noise_errors(some, row, rng, draws)], some.count)


def floor_from(drawn: Sequence[Gap], windows: int) -> Floor:
    """The floor from the gaps that noise alone made on so many windows."""
    total = np.array([g.total**2 for g in drawn])
    channels = np.array([g.channels**2 for g in drawn])
    return Floor(
        float(np.sqrt(total.mean())),
        np.sqrt(channels.mean(axis=0)),
        float(with_luck(total, windows)),
        with_luck(channels, windows),
        windows,
    )


def with_luck(squares: np.ndarray, windows: int) -> np.ndarray:
    """The gap that noise hardly ever exceeds, from squared gaps (draws, ...) that it alone made on so many windows:
    they are taken for a chi-squared variable with the degrees of freedom that their scatter tells (Satterthwaite
    1946)."""
    mean = squares.mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        freedom = np.clip(2.0 * mean**2 / squares.var(axis=0, ddof=1), 1.0, PER_WINDOW * windows)
    return np.asarray(np.sqrt(mean * chdtri(freedom, LUCK) / freedom))


def beyond(gap: Gap, floor: Floor) -> bool:
    """Whether a gap is beyond the noise, in all or in one channel."""
    few = 1.0 + FEW / floor.windows
    if gap.total > max(few * MARGIN * floor.total, floor.luck):
        return True
    with np.errstate(invalid="ignore"):
        return bool((gap.channels > np.maximum(few * CHANNEL_MARGIN * floor.channels, floor.channel_luck)).any())


def as_good_as_told(gap: Gap, floor: Floor) -> bool:
    """Whether a gap is as small as these sensors can tell, in all and in each channel."""
    if gap.total > max(AS_GOOD * floor.total, SMALL):
        return False
    with np.errstate(invalid="ignore"):
        return not bool((gap.channels > np.maximum(AS_GOOD * floor.channels, SMALL)).any())


def verdict_of(looks: Sequence[AtHorizon]) -> Verdict:
    """What the gaps say of an explanation that helps."""
    return "effects" if all(as_good_as_told(x.steady, x.floor) for x in looks) else "partial"


def clearest(looks: Sequence[AtHorizon]) -> AtHorizon:
    """The horizon at which the gap stands out of the noise most."""
    return max(looks, key=lambda x: x.before.total / max(x.floor.total, 1e-12))


def left_share(look: AtHorizon) -> float:
    """Of the squared gap beyond the noise floor, what is left."""
    excess = max(look.before.total**2 - look.floor.total**2, 1e-12)
    return float(np.clip((look.after.total**2 - look.floor.total**2) / excess, 0.0, 1.0))
