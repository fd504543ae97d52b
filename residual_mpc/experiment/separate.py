"""How well a motion would part two explanations: it is driven in simulation under the one, and the other is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.space import build_space
from residual_mpc.experiment.bench import Bench
from residual_mpc.experiment.motions import Motion, scaled
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Values

SMALLER, TRIES = 0.7, 5


@dataclass(frozen=True)
class Planned:
    """motion, made smaller where joints would leave their ranges; within: whether they are predicted to stay inside."""

    motion: Motion
    within: bool


@dataclass(frozen=True)
class Separation:
    """planned: the motion, as large as the limits of the joints allow; losses: (n, n) likelihood ratio by which
    explanation j is expected to lose where i is true, residuals as coloured as in the runs so far; infinite for i = j.
    """

    planned: Planned
    losses: np.ndarray

    @property
    def ratio(self) -> float:
        """The smallest over all pairs and both ways round."""
        return float(self.losses.min())


def separation(
    robot: Robot, bench: Bench, motion: Motion, explanations: Sequence[Values], rng: np.random.Generator
) -> Separation:
    """explanations: two or more, of which one is true."""
    planned = allowed(robot, bench, motion, explanations[0])
    losses = np.full((len(explanations), len(explanations)), np.inf)
    for i, true in enumerate(explanations):
        wrong = [k for k in range(len(explanations)) if k != i]
        problem = _problem(robot, driven(robot, bench, planned.motion, true, rng), bench, explanations)
        own, *others = fit_all(problem, [true, *(explanations[k] for k in wrong)])
        losses[i, wrong] = [(other.cost - own.cost) / bench.dispersion for other in others]
    return Separation(planned, losses)


def driven(robot: Robot, bench: Bench, motion: Motion, true: Values, rng: np.random.Generator) -> Run:
    """The run that such a robot would log, noise included."""
    readings = _readings(robot, bench, motion, true)
    noisy = {c: y + bench.sigma[c] * rng.standard_normal(len(y)) for c, y in readings.items()}
    return Run(motion.name, motion.t, {**_commands(bench, motion), **noisy})


def _readings(robot: Robot, bench: Bench, motion: Motion, values: Values) -> dict[str, np.ndarray]:
    """channel -> (n,) what the sensors report under `values`, from rest at the bench's start; one long window."""
    resting = {c: np.full(len(motion.t), bench.start.get(c, 0.0)) for c in bench.sigma}
    run = Run(motion.name, motion.t, {**_commands(bench, motion), **resting})
    whole = build_dataset([run], [robot], dict(bench.sigma), float(motion.t[-1]))
    found = predict(whole, build_space(whole, (), _effects(values), ()).settings([values]))[0, 0]
    at = np.searchsorted(motion.t, whole.t[0] + 1e-9) - 1
    out = {}
    for k, channel in enumerate(whole.channels):
        y = resting[channel].copy()
        good = np.isfinite(whole.t[0]) & np.isfinite(found[:, k])
        y[np.clip(at[good], 0, len(y) - 1)] = found[good, k]
        out[channel] = y
    return out


def _commands(bench: Bench, motion: Motion) -> dict[str, np.ndarray]:
    columns = {f"command.{a}": motion.command[:, k] for k, a in enumerate(bench.actuators)}
    if motion.enabled is not None:
        columns |= {f"enabled.{a}": motion.enabled[:, k] for k, a in enumerate(bench.actuators)}
    return columns


def _problem(robot: Robot, run: Run, bench: Bench, explanations: Sequence[Values]) -> Problem:
    data: Dataset = build_dataset([run], [robot], dict(bench.sigma))
    effects = tuple(dict.fromkeys(e for v in explanations for e in _effects(v)))
    return build_problem(data, build_space(data, (), effects, ()), data.sigma)


def _effects(values: Values) -> tuple[str, ...]:
    return tuple(dict.fromkeys(k.effect for k in values if k.effect != TUNE))


def allowed(robot: Robot, bench: Bench, motion: Motion, values: Values) -> Planned:
    """The motion, made smaller (at most TRIES times) until no joint is predicted to leave its range."""
    for _ in range(TRIES):
        if _within(robot, bench, motion, values):
            return Planned(motion, True)
        motion = scaled(motion, bench, SMALLER)
    return Planned(motion, _within(robot, bench, motion, values))


def _within(robot: Robot, bench: Bench, motion: Motion, values: Values) -> bool:
    """Whether every joint whose position is logged is predicted to stay in the range that the model gives it."""
    limits = optional.limits(robot)
    if not limits:
        return True
    seen = _readings(robot, bench, motion, values)
    return all(
        low <= y.min() and y.max() <= high
        for joint, (low, high) in limits.items()
        if (y := seen.get(f"position.{joint}")) is not None
    )
