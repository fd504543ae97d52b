"""Whether the error of the model's own time step is all that there is of a gap."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of, with_sound_starts
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor, beyond
from residual_mpc.diagnosis.predict.step_error import finest_prediction, step_error
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


def only_the_step(horizons: Sequence[Seen], row: Settings, settings: ResultSettings) -> bool:
    """Whether the model (settings, one row), stepped infinitely finely, predicts to within the noise at every horizon,
    though it does not as it is stepped. That is not asked where the step's error is a small part of the gap at the
    first."""
    first = horizons[0]
    error = step_error(first.data, first.scales, row, settings=settings.data)
    gap = gap_of(first.data, first.scales, first.error).total
    excess = max(gap**2 - first.floor.total**2, 0.0)
    if error is None or error**2 < settings.gaps.step_part * excess:
        return False
    return not any(_stepped_finely(seen, row).beyond_noise(settings) for seen in horizons)


def _stepped_finely(seen: Seen, row: Settings) -> Seen:
    apart = finest_prediction(seen.data, row)
    return seen if apart is None else Seen(seen.data, seen.error - apart, seen.scales, seen.floor)
