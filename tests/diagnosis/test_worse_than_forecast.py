"""A model is unusable where a forecast without a model is better for certain, not where the two are alike."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.results.forecast import worse_than_forecast
from residual_mpc.diagnosis.results.settings import ResultSettings

ROVER = DiffDrive("rover", 0.05, 0.3)


@pytest.mark.parametrize(("model", "expected"), [(0.25, False), (0.42, False), (0.9, True)])
def test_a_model_is_unusable_where_it_is_worse_for_certain(model: float, expected: bool) -> None:
    """Errors that scatter from window to window, those of the forecast about 0.4 of the motion."""
    data = build_dataset([rover_run("r", {}, 60.0)], [ROVER], SIGMA)
    scales, rng = measure_scales(data), np.random.default_rng(0)
    size = rng.lognormal(0.0, 0.5, (2, data.count, 1, 1))
    ours, forecast = (
        share * each * np.ones(data.y.shape) * scales.s for share, each in zip((model, 0.4), size, strict=True)
    )
    judged = np.ones(data.count)
    assert worse_than_forecast(data, scales, ours, forecast, judged, settings=ResultSettings()) == expected
