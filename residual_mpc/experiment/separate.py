"""How well a motion would part two explanations: it is driven in simulation under the one, and the other is fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import Problem, build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.step_error import within_step_error
from residual_mpc.experiment.drive_setup import DriveSetup
from residual_mpc.experiment.motions import Motion, scaled, slowed
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Values

SMALLER, TRIES = 0.7, 5
SHARE = 0.7  # of a joint's speed limit: the fastest that its servo's command may change, since it may overshoot


@dataclass(frozen=True)
class Planned:
    """motion, with commands that keep to the joints' speed limits, made smaller where joints would leave their ranges
    or exceed their speeds all the same; within: whether they are predicted to stay inside."""

    motion: Motion
    within: bool


@dataclass(frozen=True)
class Separation:
    """planned: the motion, as large as the limits of the joints allow; losses: (n, n) likelihood ratio by which
    explanation j is expected to lose where i is true, residuals as coloured as in the runs so far; 0 where the two
    differ by less than the error of the model's own time step, infinite for i = j.
    """

    planned: Planned
    losses: np.ndarray

    @property
    def ratio(self) -> float:
        """The smallest over all pairs and both ways round."""
        return float(self.losses.min())


def separation(
    robot: Robot, setup: DriveSetup, motion: Motion, explanations: Sequence[Values], rng: np.random.Generator
) -> Separation:
    """explanations: two or more, of which one is true."""
    planned = within_limits(robot, setup, motion, explanations[0])
    losses = np.full((len(explanations), len(explanations)), np.inf)
    for i, true in enumerate(explanations):
        wrong = [k for k in range(len(explanations)) if k != i]
        problem = _problem(robot, simulate_run(robot, setup, planned.motion, true, rng), setup, explanations)
        own, *others = fit_all(problem, [true, *(explanations[k] for k in wrong)], rough=True)
        rows = problem.space.settings([f.values for f in (own, *others)])
        _, *alike = within_step_error(problem.data, measure_scales(problem.data), rows, DataSettings())
        losses[i, wrong] = [
            0.0 if same else (other.cost - own.cost) / setup.dispersion
            for other, same in zip(others, alike, strict=True)
        ]
    return Separation(planned, losses)


def simulate_run(robot: Robot, setup: DriveSetup, motion: Motion, true: Values, rng: np.random.Generator) -> Run:
    """The run that such a robot would log, noise included."""
    readings = _readings(robot, setup, motion, true)
    noisy = {c: y + setup.sigma[c] * rng.standard_normal(len(y)) for c, y in readings.items()}
    return Run(motion.name, motion.t, {**_commands(setup, motion), **noisy})


def _readings(robot: Robot, setup: DriveSetup, motion: Motion, values: Values) -> dict[str, np.ndarray]:
    """channel -> (n,) what the sensors report under `values`, from rest at the setup's start; one long window."""
    resting = {c: np.full(len(motion.t), setup.start.get(c, 0.0)) for c in setup.sigma}
    run = Run(motion.name, motion.t, {**_commands(setup, motion), **resting})
    whole = build_dataset([run], [robot], dict(setup.sigma), float(motion.t[-1]))
    found = predict(whole, build_space(whole, (), _effects(values), ()).settings([values]))[0, 0]
    at = np.searchsorted(motion.t, whole.t[0] + 1e-9) - 1
    out = {}
    for k, channel in enumerate(whole.channels):
        y = resting[channel].copy()
        good = np.isfinite(whole.t[0]) & np.isfinite(found[:, k])
        y[np.clip(at[good], 0, len(y) - 1)] = found[good, k]
        out[channel] = y
    return out


def _commands(setup: DriveSetup, motion: Motion) -> dict[str, np.ndarray]:
    columns = {f"command.{a}": motion.command[:, k] for k, a in enumerate(setup.actuators)}
    if motion.enabled is not None:
        columns |= {f"enabled.{a}": motion.enabled[:, k] for k, a in enumerate(setup.actuators)}
    return columns


def _problem(robot: Robot, run: Run, setup: DriveSetup, explanations: Sequence[Values]) -> Problem:
    data: Dataset = build_dataset([run], [robot], dict(setup.sigma))
    effects = tuple(dict.fromkeys(e for v in explanations for e in _effects(v)))
    return build_problem(data, build_space(data, (), effects, ()), data.sigma)


def _effects(values: Values) -> tuple[str, ...]:
    return tuple(dict.fromkeys(k.effect for k in values if k.effect != TUNE))


def within_limits(robot: Robot, setup: DriveSetup, motion: Motion, values: Values) -> Planned:
    """The motion, with the commands of position servos no faster than a share of their joints' speed limits, made
    smaller (at most TRIES times) until no joint is predicted to leave its range or to exceed its speed. A servo follows
    whatever its gains are, which the model may not know."""
    motion = slowed(motion, _fastest(robot))
    for _ in range(TRIES):
        if _within(robot, setup, motion, values):
            return Planned(motion, True)
        motion = scaled(motion, setup, SMALLER)
    return Planned(motion, _within(robot, setup, motion, values))


def _within(robot: Robot, setup: DriveSetup, motion: Motion, values: Values) -> bool:
    """Whether every joint whose position is logged is predicted to stay in the range and within the speed that the
    model gives it."""
    limits, speeds = optional.limits(robot), optional.speed_limits(robot)
    if not limits and not speeds:
        return True
    seen = _readings(robot, setup, motion, values)
    stays = all(
        low <= y.min() and y.max() <= high
        for joint, (low, high) in limits.items()
        if (y := seen.get(f"position.{joint}")) is not None
    )
    return stays and all(
        float(np.abs(np.gradient(y, motion.t)).max()) <= most
        for joint, most in speeds.items()
        if (y := seen.get(f"position.{joint}")) is not None
    )


def _fastest(robot: Robot) -> np.ndarray:
    """(nu,) how fast the command of each position servo may change, actuator units per second; infinite for others, and
    where the model states no limit of the joint's speed."""
    known = optional.speed_limits(robot)
    each = zip(optional.actuator_joints(robot), robot.command_kinds, optional.gear_ratios(robot), strict=True)
    return np.array([SHARE * abs(g) * known[j] if k == "position" and j in known else np.inf for j, k, g in each])
