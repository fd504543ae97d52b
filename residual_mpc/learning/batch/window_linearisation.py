"""One window of a log as the filter sees it: what was measured, and what the network's outputs do to it.

The window is rolled out freely under the weights at hand, from its measured start, and compared where the gap compares
it: at the position-like samples. How each output at each step moves them is found by pushing it, one row a push, all
in one replay; that keeps every effect of the base model, delays of the sensors among them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset
from residual_mpc.diagnosis.predict.replay import beyond, earliest, more_steps, predict
from residual_mpc.learning.batch.reference_velocities import reference_velocities
from residual_mpc.learning.batch.training_problem import TrainingProblem
from residual_mpc.learning.filter.kalman import Measurement
from residual_mpc.learning.filter.window import Window
from residual_mpc.learning.forms.form import Delta, FormRollout, steps_of
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.protocol import Drive, Robot
from residual_mpc.models.settings import Settings
from residual_mpc.models.wrapped import Wrapped

FAR = 3.0  # standard deviations from which an error's cost grows with its size, not its square


@dataclass(frozen=True, eq=False)
class WindowLinearisation:
    """window and measured: for the filter. h2 (N,): |x_ref - x_pred| in each step, NaN where nothing was measured;
    seconds of data in it. samples (m,), (m,): which samples and channels are compared; weight (m,) their cost / their
    standard deviation, by which both sides are multiplied; cost: of the window under the weights at hand, see
    `cost_of`. error (M, C): measured - predicted, channel unit."""

    window: Window
    measured: Measurement
    h2: np.ndarray
    seconds: float
    samples: tuple[np.ndarray, np.ndarray]
    weight: np.ndarray
    cost: float
    error: np.ndarray




def linearise_window(
    problem: TrainingProblem, learned: Residual, w: int, nudge: np.ndarray, floor: np.ndarray
) -> WindowLinearisation:
    """Window w (row of problem.data) under the residual's weights.

    nudge (outputs,): sizes of the pushes. floor (C,) channel unit: what the model is not asked to explain of each
    channel; it stands in C_v beside the sensor noise and the doubt about the start.
    """
    one = problem.data.take(np.arange(problem.data.count) == w)
    count, rolled, predicted, readout = differentiate_rollout(problem, learned, one, nudge)
    y, t = one.y[0], one.t[0]
    keep = kept_samples(problem, y, t)
    m_index, c_index = np.nonzero(keep)
    z = rolled.z[0]
    own = learned(z)  # (N, o)
    phi = readout[:, m_index, c_index].T  # (m, o * N)
    at = predicted[m_index, c_index]
    offset = at - phi @ own.T.reshape(-1)
    a = problem.doubt[w][m_index, c_index]  # (m, k)
    sigma = one.sigma[c_index]
    noise = a @ a.T + np.diag(sigma**2) + unexplained(t[m_index], c_index, floor, one.horizon)
    scaled = learned.scaled(z)
    # channels in units of their standard deviation, so that the moments are of order one
    weight = 1.0 / np.sqrt(np.diagonal(noise))
    both = problem.cost[c_index] * weight  # of reference and prediction; C_v stays as it is, so that a cost counts
    measured = Measurement(both * y[m_index, c_index], weight[:, None] * noise * weight)
    return WindowLinearisation(
        Window(learned.net, scaled, both * offset, learned.output_scale, both[:, None] * phi, problem.workspace),
        measured,
        h2_norms(problem, one, rolled, learned.step, count),
        learned.step * count,
        (m_index, c_index),
        both,
        cost_of(measured, both * at),
        y - predicted,
    )


def cost_of(measured: Measurement, predicted: np.ndarray) -> float:
    """Mean pseudo-Huber loss of the errors under their own noise: 0.5 where all is noise; inf where not finite."""
    if not len(predicted):
        return 0.0
    e = np.linalg.solve(np.linalg.cholesky(measured.noise), measured.reference - predicted)
    if not np.isfinite(e).all():
        return float("inf")
    return float(np.mean(FAR**2 * (np.sqrt(1.0 + (e / FAR) ** 2) - 1.0)))


def cost_under(problem: TrainingProblem, learned: Residual, w: int, given: WindowLinearisation) -> float:
    """The cost of a linearise_window's window rolled out anew under other weights."""
    at = roll_out(problem, learned, w)[1][given.samples]
    return cost_of(given.measured, given.weight * at)


def unexplained(t: np.ndarray, channel: np.ndarray, floor: np.ndarray, horizon: float) -> np.ndarray:
    """(m, m) covariance of what is not to be explained at samples t (m,) s of `channel` (m,), mean square floor (C,)^2.

    A velocity that is wrong by white noise makes a position that wanders off as a random walk: errors of a window hang
    together, and count as few samples, not as many.
    """
    size = floor[channel]
    together = np.minimum(t[:, None], t[None, :]) * (channel[:, None] == channel[None, :])
    return np.asarray(2.0 / horizon * together * size[:, None] * size[None, :])


def differentiate_rollout(
    problem: TrainingProblem, learned: Residual, one: Dataset, nudge: np.ndarray
) -> tuple[int, FormRollout, np.ndarray, np.ndarray]:
    """(steps N, what was rolled, predicted (M, C), its derivative (o * N, M, C) by each output at each step)."""
    (block,) = one.blocks
    settings = problem.settings.of_group(block.group)  # rows that differ in what is pushed alone are not the same
    extra = more_steps(block.drive, earliest(block, settings), beyond(block, settings))
    longer = replace(block.drive, command=np.empty((1, block.drive.lead + block.drive.steps + extra, 1)))
    _, count = steps_of(learned.step, longer)
    outputs = len(learned.outputs)
    push = np.zeros((1 + outputs * count, count, outputs))
    for o in range(outputs):
        rows = 1 + o * count + np.arange(count)
        push[rows, np.arange(count), o] = nudge[o]
    robot, rolled = _recorded(problem, block.robot, learned, push)
    pushed = replace(one, blocks=(replace(block, robot=robot),))
    found = predict(pushed, settings.take(np.zeros(len(push), dtype=int)))[:, 0]
    size = np.repeat(nudge, count)[:, None, None]
    return count, rolled[0], found[0], np.nan_to_num((found[1:] - found[0]) / size)


def sum_of_outputs(residuals: Sequence[Residual]) -> Delta:
    """The sum of residuals of one form."""

    def delta(z: np.ndarray) -> np.ndarray:
        total = residuals[0](z)
        for r in residuals[1:]:
            total = total + r(z)
        return total

    return delta


def kept_samples(problem: TrainingProblem, y: np.ndarray, t: np.ndarray) -> np.ndarray:
    """(M, C) bool: at most `samples` of each used channel, spread evenly over those that are not missing."""
    keep = np.zeros(y.shape, dtype=bool)
    for c in np.flatnonzero(problem.used):
        there = np.flatnonzero(np.isfinite(y[:, c]) & (np.nan_to_num(t) > 0.0))
        if len(there) > problem.samples:
            there = there[np.linspace(0, len(there) - 1, problem.samples).round().astype(int)]
        keep[there, c] = True
    return keep


def h2_norms(problem: TrainingProblem, one: Dataset, rolled: FormRollout, step: float, count: int) -> np.ndarray:
    """(N,) the paper's H2 norm at each step: |x_ref - x_pred| over the velocities that the residual corrects."""
    outputs = problem.form.outputs(one.blocks[0].robot)
    late = 1.0 if problem.form.name == "joint" else 0.5  # a joint's velocity is that at the step's end
    t = one.start[0] + step * (np.arange(count) + late)
    reference = reference_velocities(one, int(one.run[0]), outputs, t)
    seen = np.isfinite(reference).any(axis=0)
    off = (reference - rolled.velocity[0])[:, seen]
    inside = t <= one.start[0] + one.horizon + 1e-9
    return np.where(inside & np.isfinite(off).all(axis=1) & seen.any(), np.linalg.norm(off, axis=1), np.nan)


def h2_of(problem: TrainingProblem, learned: Residual, w: int) -> np.ndarray:
    """(N,) H2 norms of window w under the residual as it is."""
    rolled, _ = roll_out(problem, learned, w)
    one = problem.data.take(np.arange(problem.data.count) == w)
    return h2_norms(problem, one, rolled, learned.step, rolled.velocity.shape[1])


def roll_out(problem: TrainingProblem, learned: Residual, w: int) -> tuple[FormRollout, np.ndarray]:
    """Window w under the residual as it is, and what it predicts of the samples (M, C)."""
    one = problem.data.take(np.arange(problem.data.count) == w)
    (block,) = one.blocks
    robot, rolled = _recorded(problem, block.robot, learned, None)
    predicted = predict(replace(one, blocks=(replace(block, robot=robot),)), problem.settings)
    return rolled[0], predicted[0, 0]


def _recorded(
    problem: TrainingProblem, base: Robot, learned: Residual, push: np.ndarray | None
) -> tuple[Robot, list[FormRollout]]:
    """The base with the residuals, pushed, and a list to which each of its replays adds what it rolled out.

    push (H, N, outputs): row h is for hypothesis h of one window; many hypotheses are replayed in parts, in order.
    """
    delta, rolled = sum_of_outputs((*problem.fixed, learned)), list[FormRollout]()

    def replayed(
        robot: Robot, start: Mapping[str, np.ndarray], drive: Drive, settings: Settings, wanted: tuple[str, ...]
    ) -> Mapping[str, np.ndarray]:
        done = sum(len(r.velocity) for r in rolled)
        part = None if push is None else push[done : done + settings.rows]
        rolled.append(problem.form.roll(robot, delta, learned.step, start, drive, settings, wanted, part))
        return rolled[-1].nodes

    return Wrapped(base, replayed), rolled
