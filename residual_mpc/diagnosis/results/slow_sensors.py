"""Gaps that the repeats of a slow sensor hide: in the gap they count as noise, and its new readings tell more."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.gap import gap_of
from residual_mpc.diagnosis.data.noise_model import ChannelNoise
from residual_mpc.diagnosis.data.stale import with_stale
from residual_mpc.diagnosis.predict.noise_floor import beyond_luck, floor_of
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.fitted_explanation import FittedExplanation
from residual_mpc.diagnosis.results.own_step import Seen
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.models.settings import Settings


def beyond_noise_when_fresh(
    of: FittedExplanation,
    noise: tuple[ChannelNoise, ...],
    base: Settings,
    row: Settings,
    rng: np.random.Generator,
    settings: ResultSettings,
) -> bool:
    """Whether the new readings of a slow sensor are beyond the noise, on all windows and on those that the figures are
    printed for; false where no sensor is slow. base, row: the model alone and with what explains the runs (one row
    each), whose noise floor it is."""
    if not with_stale(of.raw, {}):
        return False
    data = replace(of.clean, noise=noise)
    error = data.y - predict(data, base)[0]
    every = floor_of(data, of.scales, row, rng, settings=settings.predict)
    if not Seen(data, error, of.scales, every).beyond_noise(settings):
        return False
    there = data.take(of.test)
    floor = floor_of(there, of.scales, row, rng, settings=settings.predict)
    return beyond_luck(gap_of(there, of.scales, error[of.test]), floor)
