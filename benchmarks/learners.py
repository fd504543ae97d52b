"""The paper's claim, tested: is a UKF quicker and more robust than gradient descent? `python -m benchmarks.learners`.

The same network, the same two minutes of the stand-ins for the real robots (experiments C of the wheeled robot, B of
the arm), with outliers and without; scored on 30 s that nothing learned from and no sensor spoilt. Needs
`pip install scikit-learn` for the Gaussian process.
"""

# ruff: noqa: E402 (the threads have to be set before numpy loads)
from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import click
import numpy as np

from benchmarks.rivals import Adam, Learner, by_filter, gaussian_process, nothing
from plants.scaler_arm.kinematics.geometry import MOTORS
from plants.scaler_arm.twin import twin as arm_twin
from plants.scaler_arm.withheld import draw_withheld as draw_arm
from plants.sensors import Sensor
from plants.wheeled.simulators import bullet_drive
from plants.wheeled.twin import camera, draw_withheld, encoders, twin
from residual_mpc.learning.filter.kalman import FilterSettings
from residual_mpc.learning.stream.samples import Samples
from residual_mpc.learning.stream.updates import StreamSettings
from scenarios.experiments import arm, arm_data, wheeled, wheeled_data

SECONDS, FRESH = 120.0, 30.0
SHARE, SIZE = 0.03, 10.0  # of the samples that are outliers; of their size, in sizes of the model's error

LEARNERS: dict[str, Learner] = {
    "model alone": nothing,
    "UKF": by_filter(StreamSettings()),
    "UKF, each sample once": by_filter(StreamSettings(replays=0)),
    "UKF, each sample once, not robust": by_filter(
        StreamSettings(replays=0, kalman=FilterSettings(process=1e-6, huber=np.inf))
    ),
    "EKF": by_filter(StreamSettings(method="ekf")),
    "Adam online": Adam(online=True),
    "Adam online, Huber": Adam(huber=1.0, online=True),
    "Adam batch": Adam(),
    "Adam batch, Huber": Adam(huber=1.0),
    "Gaussian process": gaussian_process,
}


@dataclass(frozen=True)
class Case:
    """z (n, inputs), y (n, outputs): scaled; fresh_z, fresh_y: of the recording that no sensor spoilt. unit: of y."""

    z: np.ndarray
    y: np.ndarray
    fresh_z: np.ndarray
    fresh_y: np.ndarray
    unit: np.ndarray


def wheeled_case(seed: int) -> Case:
    withheld = draw_withheld(np.random.default_rng(1 + seed))
    quiet = Sensor(dict.fromkeys([f"{k}.{a}" for k in ("pose", "twist") for a in ("x", "y", "theta")], 0.0))
    parts = []
    for part, (sensor, seconds) in enumerate(((camera(0.0), SECONDS), (quiet, FRESH))):
        robot = twin(bullet_drive(step=wheeled.STEP), withheld, (sensor, encoders()))
        run = wheeled_data.drive(robot, wheeled.MOTIONS["C"], seconds, np.random.default_rng((seed, part)))
        parts.append(wheeled_data.samples(run, "paper"))
    return scaled(*parts)


def arm_case(seed: int) -> Case:
    withheld = draw_arm(np.random.default_rng(1 + seed))
    quiet = Sensor({f"{k}.{m}": 0.0 for k in ("position", "velocity") for m in MOTORS})
    parts = []
    for part, (sensor, seconds) in enumerate(((arm.ENCODERS, SECONDS), (quiet, FRESH))):
        robot = arm_twin("mujoco", withheld, (sensor,))
        run = arm_data.drive(robot, arm.MOTIONS["B"], seconds, np.random.default_rng((seed, part)))
        parts.append(arm_data.samples(run))
    return scaled(*parts)


def scaled(learn: Samples, fresh: Samples) -> Case:
    """Each learner is given the same scales, so that none owes its result to them."""
    mean, spread = learn.z.mean(axis=0), learn.z.std(axis=0)
    spread = np.where(spread > 1e-6, spread, 1.0)
    off, fresh_off = learn.reference - learn.model, fresh.reference - fresh.model
    unit = np.sqrt(np.nanmedian(off**2, axis=0) / 0.455)
    return Case((learn.z - mean) / spread, off / unit, (fresh.z - mean) / spread, fresh_off / unit, unit)


def with_outliers(case: Case, rng: np.random.Generator) -> Case:
    """SHARE of the samples off by up to SIZE either way, all components at once, as a camera's jumps are."""
    y = case.y.copy()
    hit = rng.random(len(y)) < SHARE
    y[hit] += SIZE * rng.uniform(-1.0, 1.0, (int(hit.sum()), y.shape[1]))
    return Case(case.z, y, case.fresh_z, case.fresh_y, case.unit)


def score(learner: Learner, case: Case, seed: int) -> tuple[float, float]:
    """(mean H2 norm on the fresh recording, seconds of one core)."""
    begun = process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a Gaussian process warns of lengths at their bounds
        model = learner(case.z, case.y, np.random.default_rng(seed))
    took = process_time() - begun
    off = (case.fresh_y - model(case.fresh_z)) * case.unit
    return float(np.nanmean(np.linalg.norm(off, axis=1))), took


CASES: dict[str, tuple[str, Callable[[int], Case], int]] = {
    "wheeled": ("wheeled robot, C", wheeled_case, 4),
    "arm": ("arm, B", arm_case, 5),
}


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=5, show_default=True, help="Robots, and weights to begin.")
@click.option("--robot", "robots", multiple=True, type=click.Choice(list(CASES)), help="Repeatable; both where absent.")
def learners(seeds: int, robots: tuple[str, ...]) -> None:
    """Print the held-out H2 norms, mean and standard deviation over robots, and seconds."""
    for robot, make, digits in (CASES[r] for r in robots or CASES):
        cases = [make(s) for s in range(seeds)]
        spoilt = [with_outliers(c, np.random.default_rng(s)) for s, c in enumerate(cases)]
        click.echo(f"\n{robot}: {seeds} robots\n")
        click.echo("| learner | H2 norm kept back | with outliers | s |\n| --- | --- | --- | --- |")
        for name, learner in LEARNERS.items():
            cells, seconds = [], []
            for some in (cases, spoilt):
                found = [score(learner, c, s) for s, c in enumerate(some)]
                norms = [f[0] for f in found]
                cells.append(f"{np.mean(norms):.{digits}f} +- {np.std(norms):.{digits}f}")
                seconds += [f[1] for f in found]
            click.echo(f"| {name} | {cells[0]} | {cells[1]} | {np.mean(seconds):.1f} |")


if __name__ == "__main__":
    learners()
