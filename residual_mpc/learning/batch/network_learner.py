"""The network as a diagnosis asks for it: a bounded number of updates, on top of the explanation."""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.data.subsampling import shorten
from residual_mpc.diagnosis.remainder.learning import Learner, Remainder, RidgeLearner
from residual_mpc.learning.batch.evaluation import Evaluation, without_harmful_outputs, without_outliers
from residual_mpc.learning.batch.window_updates import (
    LearnSettings,
    build_training_problem,
    first_error,
    order_of,
    prior_belief,
    step_of,
    update_over_windows,
)
from residual_mpc.learning.forms.form import Form
from residual_mpc.learning.forms.registry import default_form
from residual_mpc.learning.network.residual import Residual

FEWEST = 8  # windows to learn from


@dataclass(frozen=True)
class NetworkLearner:
    """updates: at most so many in all, on windows spread evenly over the runs; fewer windows are gone through more than
    once. scaling: of which so many give the scales. The bounds keep the cost in proportion to the diagnosis', and are
    counts, not seconds, so that a seed gives one answer."""

    updates: int = 144
    scaling: int = 10
    settings: LearnSettings = LearnSettings()
    name: str = "network"

    def left(self, of: Remainder, rng: np.random.Generator) -> np.ndarray | None:
        """As `residual_mpc.diagnosis.remainder.learning.Learner`."""
        form = default_form(of.data.blocks[0].robot)
        with threadpool_limits(1):  # nets of this size lose by a second thread
            learned = self._learned(of, form, rng)
            return None if learned is None else _examined(of, form, learned)

    def _learned(self, of: Remainder, form: Form, rng: np.random.Generator) -> Residual | None:
        data, settings, step = _course_data(of.data.take(_evenly(of.learn, self.updates)), form, self.settings)
        if data.count < FEWEST:
            return None
        passes = min(settings.passes, self.updates // data.count)
        every = np.ones(data.count, dtype=bool)
        scaling = _evenly(every, self.scaling)
        problem, blank = build_training_problem(
            data, form, step, settings, of.settings, (), scaling, ~of.scales.still, rng
        )
        belief = prior_belief(blank, settings)
        error = first_error(problem, every)
        for progress in update_over_windows(problem, blank, belief, error, order_of(every, passes, rng), settings):
            belief = progress.belief
        return blank.with_theta(belief.mean)


LEARNERS: tuple[Learner, ...] = (RidgeLearner(), NetworkLearner())  # whom `residual-mpc diagnose` asks


def _evenly(mask: np.ndarray, count: int) -> np.ndarray:
    """(W,) bool: at most `count` of the windows of `mask`, evenly spread."""
    rows = np.flatnonzero(mask)
    out = np.zeros_like(mask)
    out[rows[np.unique(np.linspace(0, len(rows) - 1, min(count, len(rows))).round().astype(int))]] = True
    return out


def _course_data(data: Dataset, form: Form, settings: LearnSettings) -> tuple[Dataset, LearnSettings, float]:
    """The gap's windows, without jumps, cut to the learner's horizon where they are longer; its settings, its step."""
    step = step_of(form, data.blocks[0].drive.dt, settings)
    count = min(settings.horizon, max(2, round(data.horizon / step)))
    part = count * step / data.horizon
    data = without_outliers(data)
    return (shorten(data, part) if part < 1.0 - 1e-9 else data), replace(settings, horizon=count), step


def _examined(of: Remainder, form: Form, learned: Residual) -> np.ndarray:
    """(W, M, C) the error under the residual on the windows that choose and judge, NaN on the others. Outputs that make
    a channel worse on the windows that choose are switched off."""
    asked = of.choose | of.judge
    evaluation = Evaluation(of.data.take(asked), of.scales, of.settings)
    learned, _ = without_harmful_outputs(evaluation, form, learned, of.choose[asked])
    left = np.full(of.error.shape, np.nan)
    left[asked] = evaluation.error(learned)
    return left
