"""The same windows on a grid of longer steps, for a search, whose hypotheses need not be simulated exactly.

What longer steps change is measured at the hypothesis that a step of the search begins with and added to all others
(`PredictionCache.about`): only their differences from it are inexact. The last fits have the model's own steps.
"""

from dataclasses import replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.gap import Scales, gap_of
from residual_mpc.diagnosis.predict.prediction_cache import PredictionCache
from residual_mpc.diagnosis.predict.problem import Problem, about
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.predict.step_lengths import with_longer_steps
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Settings, Values

NOMINAL = Settings(1)


def quickened(data: Dataset, scales: Scales, settings: PredictSettings, row: Settings = NOMINAL) -> Dataset:
    """The windows with the longest steps that change little of the predictions of a model (one row of settings; of the
    nominal model), of the motion and of what that model leaves; the same dataset where there are none. A stiff effect,
    such as a motor's line near its no-load speed, may swing with longer steps where the nominal model does not."""
    tuned = settings.longer_steps
    shortest = min(b.drive.dt for b in data.blocks)
    keep = np.isin(np.arange(data.count), np.linspace(0, data.count - 1, min(data.count, tuned.windows)).astype(int))
    few = data.take(keep)
    own = predict(few, row)[0]
    most = min(tuned.error, tuned.of_left * gap_of(few, scales, few.y - own).total)
    for times in range(int(tuned.longest / shortest + 1e-9), 1, -1):
        longer = with_longer_steps(few, times)
        if longer is None:
            return data
        change = gap_of(few, scales, own - predict(longer, row)[0]).total
        if change < most:
            return with_longer_steps(data, times) or data
    return data


def on_longer_steps(problem: Problem, scales: Scales, values: Values, settings: PredictSettings) -> Problem:
    """The problem about these values on the longest steps that change little, itself where there are none."""
    quick = quickened(problem.data, scales, settings=settings)
    if quick is problem.data:
        return problem
    replays = PredictionCache(quick, problem.space, own=problem.data)
    return about(replace(problem, data=quick, replays=replays), values, settings=settings)


def longer_steps_of(robot: Robot, settings: PredictSettings) -> list[Robot]:
    """The robot with each of the steps that a search may take."""
    most = 0 if robot.step is None else int(settings.longer_steps.longest / robot.step + 1e-9)
    found = (optional.with_longer_step(robot, times) for times in range(2, most + 1))
    return [r for r in found if r is not None]
