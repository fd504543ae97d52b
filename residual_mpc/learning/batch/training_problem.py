"""What a network is learned from: the windows, and all that their linearisations share."""

from dataclasses import dataclass, field

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.predict.problem import start_sigma
from residual_mpc.diagnosis.predict.replay import predict_moved
from residual_mpc.learning.filter.workspace import Workspace
from residual_mpc.learning.forms.form import Form
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Settings


@dataclass(frozen=True, eq=False)
class TrainingProblem:
    """What the linearisations of all windows share.

    data: windows of N steps. settings: one row, the diagnosed effects. fixed: residuals that are not learned, summed.
    doubt (W, M, C, k): how one sigma of each start coordinate moves the prediction. samples: at most so many of a
    channel in a window. workspace: what the filter computes in.
    """

    data: Dataset
    form: Form
    settings: Settings
    fixed: tuple[Residual, ...]
    doubt: np.ndarray
    used: np.ndarray  # (C,) bool: channels that are compared and move
    cost: np.ndarray  # (C,) the paper's C: how much each channel's errors count, 1 as a rule
    samples: int = 20
    workspace: Workspace = field(default_factory=Workspace)


def start_doubt(data: Dataset, settings: Settings) -> np.ndarray:
    """(W, M, C, k): how one inflated standard deviation of each start coordinate moves the base's prediction."""
    moves: list[dict[str, np.ndarray]] = [{c: size} for c, size in start_sigma(data).items() if size.any()]
    if not moves:
        return np.zeros((*data.y.shape, 1))
    base, *moved = predict_moved(data, settings, [{}, *moves])
    return np.stack([np.nan_to_num(m - base) for m in moved], axis=-1)
