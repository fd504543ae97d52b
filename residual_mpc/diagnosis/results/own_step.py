"""Whether the error of the model's own time step is all that there is of a gap."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, with_sound_starts
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, beyond
from residual_mpc.diagnosis.predict.step_error import finest_prediction, step_error, step_share
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class Seen:
    """Errors of a model (W, M, C), channel units, on the windows of one horizon, and the floor of noise there."""

    data: Dataset
    error: np.ndarray
    scales: Scales
    floor: NoiseFloor

    def beyond_noise(self, settings: ResultSettings) -> bool:
        """Whether the errors are beyond the noise on these windows, and not because of one window whose start is
        wrong."""
        tuned = settings.predict
        every = gap_of(self.data, self.scales, self.error)
        sound = with_sound_starts(self.data, self.scales, self.error, tuned.floor.sound_from)
        return beyond(every, self.floor, settings=tuned) and beyond(sound, self.floor, settings=tuned)

    def from_the_step(self, row: Settings) -> np.ndarray | None:
        """(W, M, C) the step's part of the errors of the model (settings, one row); None if it has no other step."""
        return finest_prediction(self.data, row, self.data.y - self.error)

    def less(self, share: float, apart: np.ndarray | None) -> "Seen":
        """Without that share of the step's error (W, M, C)."""
        return self if apart is None else replace(self, error=self.error - share * apart)


def only_the_step(horizons: Sequence[Seen], row: Settings, settings: ResultSettings) -> bool:
    """Whether the model (settings, one row), stepped more finely, predicts to within the noise at every horizon, or to
    within a small part of the step's error, though it does not as it is stepped. How much more finely is fitted, since
    what made the runs may have a step of its own. That is not asked where the step's error is a small part of the gap
    at the first."""
    first = horizons[0]
    error = step_error(first.data, first.scales, row, settings=settings.data)
    gap = gap_of(first.data, first.scales, first.error).total
    excess = max(gap**2 - first.floor.total**2, 0.0)
    if error is None or error**2 < settings.gaps.step_part * excess:
        return False
    apart = first.from_the_step(row)
    share = 0.0 if apart is None else step_share(first.data, first.scales, first.error, apart, settings.data)
    if not _explained(first, share, apart, settings):
        return False
    return all(_explained(s, share, s.from_the_step(row), settings) for s in horizons[1:])


def _explained(seen: Seen, share: float, apart: np.ndarray | None, settings: ResultSettings) -> bool:
    """Whether nothing is left beyond the noise without that share of the step's error (W, M, C), or so small a part of
    that error that the extrapolation to an infinitely small step may have missed it."""
    left = seen.less(share, apart)
    if apart is None or not left.beyond_noise(settings):
        return not left.beyond_noise(settings)
    rest, step = (gap_of(seen.data, seen.scales, e).total for e in (left.error, share * apart))
    return bool(rest**2 - seen.floor.total**2 < (settings.gaps.step_rest * step) ** 2)
