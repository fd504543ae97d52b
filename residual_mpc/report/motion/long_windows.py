"""The windows of a diagnosis's longest horizon: over one second a robot that drives hardly leaves its outline."""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.models.settings import assemble
from residual_mpc.models.targets import Targets


def over_longest(made: DiagnosisResult) -> DiagnosisResult | None:
    """The same models on these windows; None where there is no longer horizon, or where runs differ in their model."""
    data = made.data
    horizon = max((h.horizon for h in made.diagnosis.gap.horizons), default=data.horizon)
    if made.diagnosis.groups_of_windows:
        return None  # their windows are told apart at one horizon alone
    if horizon <= data.horizon or len(data.blocks) != 1 or data.blocks[0].drive.setting is not None:
        return None
    robot = data.blocks[0].robot
    long = build_dataset(data.runs, [robot] * len(data.runs), data.stated, horizon)
    slots = Targets(robot)
    before, after = predict(long, assemble([made.base, made.diagnosis.values], slots))
    held, scales = np.zeros(long.count, dtype=bool), measure_scales(long)
    return replace(made, data=long, scales=scales, before=long.y - before, after=long.y - after, held=held)
