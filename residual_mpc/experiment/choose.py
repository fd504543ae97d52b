"""The motion (and, where no motion will do, the sensor) that parts the explanations best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.dataset import build_dataset
from residual_mpc.diagnosis.fit import fit_all
from residual_mpc.diagnosis.problem import build_problem
from residual_mpc.diagnosis.search_settings import SearchSettings
from residual_mpc.diagnosis.space import build_space
from residual_mpc.diagnosis.testable import NotTestable, not_testable
from residual_mpc.experiment.bench import Bench, with_encoders
from residual_mpc.experiment.motions import Motion, motions
from residual_mpc.experiment.separate import Planned, Separation, allowed, driven, separation
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values

PARTS = SearchSettings().beyond_doubt  # likelihood ratio

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Experiment:
    """motions: all that were tried, best first; sensors: channels to log besides, without which none of them will do;
    each motion's ratio is with these."""

    motions: tuple[Separation, ...]
    sensors: tuple[str, ...]

    @property
    def best(self) -> Separation:
        return self.motions[0]

    @property
    def parts(self) -> bool:
        """Whether the best motion is expected to part them beyond doubt."""
        return self.best.ratio >= PARTS


def choose(
    robot: Robot,
    bench: Bench,
    explanations: Sequence[Values],
    seconds: float,
    rng: np.random.Generator,
    progress: Progress = lambda text, done: None,
) -> Experiment:
    """Try every motion in simulation, and log the wheels' encoders where no motion alone will do."""
    tried = motions(bench, seconds, rng)
    encoded, sensors = with_encoders(bench, robot)
    alone = _ranked(robot, bench, tried, explanations, rng, progress, 0.0, 0.5 if sensors else 1.0)
    if alone[0].ratio >= PARTS or not sensors:
        return Experiment(alone, ())
    with_them = _ranked(robot, encoded, tried, explanations, rng, progress, 0.5, 1.0)
    better = with_them[0].ratio >= max(PARTS, 2.0 * alone[0].ratio)
    return Experiment(with_them, sensors) if better else Experiment(alone, ())


def protocol(
    robot: Robot, bench: Bench, seconds: float, rng: np.random.Generator
) -> tuple[tuple[Planned, ...], tuple[NotTestable, ...]]:
    """Every motion once, for a robot without runs, and the effects that even these would not show."""
    planned = [allowed(robot, bench, m, {}) for m in motions(bench, seconds, rng)]
    runs = [driven(robot, bench, p.motion, {}, rng) for p in planned]
    data = build_dataset(runs, [robot] * len(runs), dict(bench.sigma))
    problem = build_problem(data, build_space(data, ()), data.sigma)
    return tuple(planned), not_testable(problem, fit_all(problem, [{}])[0], ())


def _ranked(
    robot: Robot,
    bench: Bench,
    tried: Sequence[Motion],
    explanations: Sequence[Values],
    rng: np.random.Generator,
    progress: Progress,
    begin: float,
    end: float,
) -> tuple[Separation, ...]:
    found = []
    for k, motion in enumerate(tried):
        progress(motion.name, begin + (end - begin) * k / len(tried))
        found.append(separation(robot, bench, motion, explanations, rng))
    return tuple(sorted(found, key=lambda s: -s.ratio))
