"""Learning a residual from runs: one update a window."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.errors import BadInput
from residual_mpc.learning.batch.training_problem import TrainingProblem, start_doubt
from residual_mpc.learning.batch.window_linearisation import (
    WindowLinearisation,
    cost_under,
    differentiate_rollout,
    linearise_window,
)
from residual_mpc.learning.filter import ekf, ukf
from residual_mpc.learning.filter.guarded_update import guarded_update
from residual_mpc.learning.filter.kalman import Belief, FilterSettings, UpdateInfo, initial_belief
from residual_mpc.learning.filter.workspace import Workspace
from residual_mpc.learning.forms.form import Form
from residual_mpc.learning.network.mlp import PAPER_HIDDEN, Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.settings import Settings

HALVINGS = 3  # of an update that makes its own window worse
LIMIT = 6.0  # input scales
LARGE = 400  # weights from which the exact Jacobian replaces the sigma points


@dataclass(frozen=True)
class LearnSettings:
    """hidden: nodes of the hidden layers. horizon: N, steps in an update. step: s of a step, None for the form's usual.

    variance: of each weight before any data; the network's inputs and outputs are scaled to about one. goal: share of
    each channel's present error (its root mean square over about `memory` windows) that an update does not try to
    explain: it stands in C_v beside the sensor noise, for what no memoryless network can follow would otherwise be
    taken for certain. passes: how often the data are gone through. fair: a window's cost (see `cost_of`) up to which it
    counts as explained. costs: (channel, the paper's C) where a channel counts more or less than 1. method: "ukf",
    "ekf", or "auto" for the UKF up to LARGE weights.
    """

    hidden: tuple[int, ...] = PAPER_HIDDEN
    horizon: int = 20
    step: float | None = None
    variance: float = 0.1
    goal: float = 0.5
    memory: float = 20.0
    passes: int = 5
    kalman: FilterSettings = FilterSettings()
    fair: float = 0.5
    costs: tuple[tuple[str, float], ...] = ()
    method: str = "auto"

    def __post_init__(self) -> None:
        if self.horizon < 2 or self.passes < 1 or not self.variance > 0.0 or not 0.0 <= self.goal < 1.0:
            raise ValueError(f"horizon must be >= 2, passes >= 1, variances > 0 and the goal < 1, got {self}")
        if self.method not in ("auto", "ukf", "ekf"):
            raise ValueError(f"method must be auto, ukf or ekf, got {self.method!r}")


USUAL_STEP = {"body": 0.05, "paper": 0.05, "joint": 0.02}  # s


@dataclass(frozen=True, eq=False)
class Progress:
    """After an update: its number, seconds of data so far, the H2 norms of the window before it, the filter's time.

    error (C,): mean square error of each channel of late, channel unit squared.
    """

    update: int
    seconds: float
    h2: np.ndarray
    update_ms: float
    info: UpdateInfo
    belief: Belief
    error: np.ndarray


def step_of(form: Form, grid: float, settings: LearnSettings) -> float:
    """The residual's step in s: whole steps of the replay's grid."""
    wanted = settings.step or USUAL_STEP[form.name]
    return max(1, round(wanted / grid)) * grid


def build_training_problem(
    data: Dataset, form: Form, step: float, settings: LearnSettings, effects: Settings,
    fixed: Sequence[Residual], scaling: np.ndarray, used: np.ndarray, rng: np.random.Generator,
) -> tuple[TrainingProblem, Residual]:  # fmt: skip
    """The problem over the windows of `data`, and a residual of zero with scales from the windows `scaling` (W,)."""
    base = data.blocks[0].robot
    inputs, outputs = form.inputs(base), form.outputs(base)
    net = Mlp(len(inputs), settings.hidden, len(outputs))
    blank = Residual(
        net, initial_weights(net, rng), inputs, outputs, np.zeros(net.inputs), np.ones(net.inputs),
        np.ones(net.outputs), form.name, step, base.name, LIMIT,
    )  # fmt: skip
    cost = costs_of(settings, data.channels)
    problem = TrainingProblem(
        data, form, effects, tuple(fixed), start_doubt(data, effects), used, cost, settings.horizon
    )
    return problem, with_scales(problem, blank, scaling, rng)


def costs_of(settings: LearnSettings, channels: Sequence[str]) -> np.ndarray:
    """(C,) of the channels. Raises BadInput for a channel that is not measured, or a cost that is not positive."""
    cost = np.ones(len(channels))
    for channel, value in settings.costs:
        if channel not in channels:
            raise BadInput(
                f"unknown channel {channel!r}", "`weights`", f"the measured channels are {', '.join(channels)}"
            )
        if not (np.isfinite(value) and value > 0.0):
            raise BadInput(f"{channel} must be a number > 0, got {value}", "`weights`", "the default is 1")
        cost[channels.index(channel)] = value
    return cost


def with_scales(
    problem: TrainingProblem, blank: Residual, scaling: np.ndarray, rng: np.random.Generator, few: int = 40
) -> Residual:
    """Input scales from the model's own motion; output scales: the size of the constant residual, window by window,
    that would explain what the base leaves."""
    at = np.flatnonzero(scaling)
    at = np.sort(rng.permutation(at)[:few])
    z, wanted = [], []
    nudge = np.full(len(blank.outputs), 1e-2)
    for w in at:
        one = problem.data.take(np.arange(problem.data.count) == w)
        count, rolled, predicted, readout = differentiate_rollout(problem, blank, one, nudge)
        z.append(rolled.z[0])
        error = np.where(problem.used & np.isfinite(one.y[0]), one.y[0] - predicted, 0.0) / one.sigma
        through = np.where(np.isfinite(one.y[0]) & problem.used, readout / one.sigma, 0.0)
        held = through.reshape(len(blank.outputs), count, -1).sum(axis=1).T  # (M C, o)
        wanted.append(np.linalg.lstsq(held, error.reshape(-1), rcond=1e-6)[0])
    stacked = np.concatenate(z)
    spread = stacked.std(axis=0)
    spread = np.where(spread > 1e-6 * (1.0 + np.abs(stacked).max(axis=0)), spread, 1.0)  # a constant input says nothing
    size = np.sqrt(np.median(np.square(wanted), axis=0) / 0.455)
    size = np.maximum(size, 1e-6 * (1.0 + size.max()))
    for i, name in enumerate(blank.inputs):  # a velocity that feeds back moves by what is learned as well
        if name.startswith("previous."):
            fed_back = size[blank.outputs.index(name.removeprefix("previous."))]
            spread[i] = np.hypot(stacked[:, i].std(), fed_back)
    return replace(blank, input_mean=stacked.mean(axis=0), input_scale=spread, output_scale=size)


def order_of(seen: np.ndarray, passes: int, rng: np.random.Generator) -> np.ndarray:
    """The windows `seen` (W,) shuffled, pass after pass.

    In the order of the log the filter forgets the first motion over the last, and the H2 norm over time tells of the
    motions instead of the learning.
    """
    rows = np.flatnonzero(seen)
    return np.concatenate([rng.permutation(rows) for _ in range(passes)])


def filter_of(method: str, size: int) -> Callable[..., tuple[Belief, UpdateInfo]]:
    """The update of the chosen filter; auto: the UKF while it costs a millisecond, the EKF for larger nets."""
    if method == "auto":
        method = "ukf" if size < LARGE else "ekf"
    workspace = Workspace()
    return partial(ukf.update, workspace=workspace) if method == "ukf" else ekf.update


def update_over_windows(
    problem: TrainingProblem, learned: Residual, belief: Belief, error: np.ndarray, order: np.ndarray,
    settings: LearnSettings, first: int = 0,
) -> Iterator[Progress]:  # fmt: skip
    """Update after update over the windows `order` (rows of problem.data), from number `first` on.

    error (C,): mean square error of each channel before, see `first_error`.
    """
    update = filter_of(settings.method, learned.net.size)
    nudge = 0.1 * learned.output_scale
    seconds = first * learned.step * settings.horizon
    for k in range(first, len(order)):
        w = int(order[k])
        floor = settings.goal * np.sqrt(error)
        given = linearise_window(problem, learned.with_theta(belief.mean), w, nudge, floor)
        begun = perf_counter()
        moved, info = update(belief, given.window, given.measured, settings.kalman)
        took = 1e3 * (perf_counter() - begun)
        belief = guarded_window_update(problem, learned, w, given, belief, moved, settings)
        error = error_of_late(error, given.error, settings.memory)
        seconds += given.seconds  # of data, passes counted anew
        yield Progress(k + 1, seconds, given.h2, took, info, belief, error)


def first_error(problem: TrainingProblem, windows: np.ndarray) -> np.ndarray:
    """(C,) mean square error of each channel under what stands still, over the windows (W,) bool, robustly."""
    data = problem.data
    error = np.where(windows[:, None, None], data.y - predict(data, problem.settings)[0], np.nan)
    return np.array([_mean_square(error[..., c]) for c in range(error.shape[2])])


def error_of_late(before: np.ndarray, error: np.ndarray, memory: float) -> np.ndarray:
    """(C,) the running mean square with one window's error (M, C) in it, which counts for 9 times the mean at most."""
    square = error**2
    seen = np.isfinite(square).any(axis=0)
    now = np.where(seen, np.nansum(square, axis=0) / np.maximum(np.isfinite(square).sum(axis=0), 1), before)
    return np.asarray(before + (np.minimum(now, 9.0 * before) - before) / memory)


def _mean_square(error: np.ndarray) -> float:
    good = error[np.isfinite(error)]
    return float(np.median(good**2) / 0.455) if len(good) else 0.0  # 0.455: a normal's median square


def guarded_window_update(
    problem: TrainingProblem,
    learned: Residual,
    w: int,
    given: WindowLinearisation,
    before: Belief,
    after: Belief,
    settings: LearnSettings,
) -> Belief:
    """The update, shortened where it makes its own window worse when that is rolled out anew."""

    def cost(theta: np.ndarray) -> float:
        return cost_under(problem, learned.with_theta(theta), w, given)

    if given.cost <= settings.fair and cost(after.mean) <= settings.fair:
        return after
    return guarded_update(before, after, lambda theta: cost(theta) <= given.cost, HALVINGS, settings.kalman)[0]


def prior_belief(learned: Residual, settings: LearnSettings) -> Belief:
    """The belief before any data."""
    return initial_belief(learned.theta, settings.variance)
