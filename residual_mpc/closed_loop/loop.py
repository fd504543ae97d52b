"""The loop: measure, estimate, plan, act."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.estimator import Filter
from residual_mpc.closed_loop.protocols import Controller, Reading, Reference, Simulator

Learner = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray | None]
# what an online learner sees at each sample: believed x (nx,), command (nu,), reading of the poses (ny,); it answers
# with new parameters p (np,), or None while there is nothing new


@dataclass(frozen=True)
class LoopSettings:
    """seconds: length of an episode. dt: s between samples, the model's own."""

    seconds: float
    dt: float

    @property
    def samples(self) -> int:
        return int(round(self.seconds / self.dt)) + 1


def run_closed_loop(
    simulator: Simulator,
    estimator: Filter,
    controller: Controller,
    reference: Reference,
    settings: LoopSettings,
    rng: np.random.Generator,
    name: str = "episode",
    learner: Learner | None = None,
    at: Reading | None = None,
) -> Episode:
    """Drive from `at` on, by default from the reference's first pose. The same rng state gives the same plant, noise
    and episode.

    Simulated time waits for the controller: how long it took is kept in the episode, and decides nothing here.
    """
    dt, n = settings.dt, settings.samples
    model = estimator.model
    poses, names = model.stepped.poses, model.stepped.tracked
    wanted = reference.path(dt * np.arange(n + controller.horizon))
    if at is None:
        at = dict(zip(poses, wanted[0].tolist(), strict=True))
    rows = _Rows(n, len(simulator.actuators), len(names), simulator.channels)
    plant = simulator.start(rng, at)
    try:
        belief, state = estimator.init(at), controller.init()
        command: np.ndarray | None = None
        for k in range(n):
            reading, truth = plant.measure(), plant.truth()
            x, belief = estimator.step(belief, command, reading)
            believed = estimator.outputs(x)
            ahead = _unwrapped(wanted[k + 1 : k + 1 + controller.horizon], believed, names)
            command, state, info = controller.step(state, x, ahead)
            rows.keep(k, reading, tracked_of(estimator, truth), command, believed)
            rows.seconds[k], rows.outcomes[k] = info.seconds, info.outcome
            rows.predicted[k] = (estimator.outputs(estimator.drive(x, command)) - believed) / dt
            if learner is not None:
                seen = np.array([reading.get(c, np.nan) for c in poses])
                p = learner(x, command, seen)
                if p is not None:
                    estimator, controller = estimator.with_parameters(p), controller.with_parameters(p)
            if k + 1 < n:
                plant.step(command, dt)
    finally:
        plant.close()
    happened = np.full_like(rows.truth, np.nan)
    happened[:-1] = np.diff(rows.truth, axis=0) / dt
    rows.predicted[-1] = np.nan
    return Episode(
        name, tuple(simulator.actuators), names, dt * np.arange(n), rows.command, rows.measured, rows.truth,
        wanted[:n], rows.believed, rows.predicted, happened, rows.seconds, tuple(rows.outcomes),
    )  # fmt: skip


def tracked_of(estimator: Filter, reading: Reading) -> np.ndarray:
    """(ny,) what the model tracks, as a reading has it; what it does not report, as the model has it of the poses."""
    at = estimator.model.stepped
    if at.output is None:
        return np.array([reading[c] for c in at.poses])
    y = estimator.outputs(estimator.model.at_rest({c: reading[c] for c in at.poses}))
    return np.array([reading.get(name, value) for name, value in zip(at.tracked, y.tolist(), strict=True)])


def _unwrapped(ahead: np.ndarray, pose: np.ndarray, poses: tuple[str, ...]) -> np.ndarray:
    """The reference on the same turn of the circle as the estimate."""
    if "pose.theta" not in poses:
        return ahead
    i = poses.index("pose.theta")
    out = ahead.copy()
    out[:, i] += 2 * np.pi * np.round((pose[i] - ahead[0, i]) / (2 * np.pi)) if np.isfinite(pose[i]) else 0.0
    return out


class _Rows:
    """The arrays of an episode while it is driven."""

    def __init__(self, n: int, nu: int, ny: int, channels: tuple[str, ...]) -> None:
        self.command, self.seconds = np.zeros((n, nu)), np.zeros(n)
        self.truth, self.believed, self.predicted = (np.zeros((n, ny)) for _ in range(3))
        self.measured = {c: np.full(n, np.nan) for c in channels}
        self.outcomes = [""] * n

    def keep(self, k: int, reading: Reading, truth: np.ndarray, command: np.ndarray, believed: np.ndarray) -> None:
        for c, values in self.measured.items():
            values[k] = reading.get(c, np.nan)
        self.truth[k] = truth
        self.command[k], self.believed[k] = command, believed
