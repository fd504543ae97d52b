"""The motion (and, where no motion will do, the sensor or the switch) that parts the explanations best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from residual_mpc.checkpoint import at_once
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.diagnosis.search.testable import NotTestable, not_testable
from residual_mpc.experiment.drive_setup import DriveSetup, with_encoders
from residual_mpc.experiment.motions import Motion, motions
from residual_mpc.experiment.separate import Planned, Separation, separation, simulate_run, within_limits
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import Values

PARTS = SearchSettings.beyond_doubt  # likelihood ratio from which sets come apart: the default of the search
MOST = 3  # motions in an experiment

Progress = Callable[[str, float], None]
Keep = Callable[
    [str, Callable[[], Separation]], Separation
]  # a step's name and the step -> its result, maybe of before


@dataclass(frozen=True)
class Experiment:
    """motions: all that were tried, best first; played: those to drive, one unless it takes more; sensors: channels to
    log besides, switches: whether motors have to be switched off, without which none of them will do; each motion's
    ratio is with these."""

    motions: tuple[Separation, ...]
    played: tuple[Separation, ...]
    sensors: tuple[str, ...]
    switches: bool

    @property
    def losses(self) -> np.ndarray:
        """(n, n) of all that is played: the likelihood ratios of separate runs add."""
        return np.asarray(np.sum([s.losses for s in self.played], axis=0))

    @property
    def ratio(self) -> float:
        """The smallest over all pairs."""
        return float(self.losses.min())

    @property
    def parts(self) -> bool:
        """Whether what is played is expected to part them beyond doubt."""
        return self.ratio >= PARTS


def choose(
    robot: Robot,
    setup: DriveSetup,
    explanations: Sequence[Values],
    seconds: float,
    rng: np.random.Generator,
    progress: Progress = lambda text, done: None,
    keep: Keep = at_once,
) -> Experiment:
    """Try every motion in simulation; where none will do alone, with the wheels' encoders logged, or the motors off at
    times. keep: where the motions that were tried are kept."""
    tried = motions(setup, seconds, rng)
    encoded, sensors = with_encoders(setup, robot)
    switched = () if setup.switches else motions(replace(setup, switches=True), seconds, rng)[len(tried) :]
    best = _of(_ranked(robot, setup, tried, explanations, rng, progress, (0.0, 0.6), keep), (), False)
    if not best.parts and sensors:
        found = _ranked(robot, encoded, tried, explanations, rng, progress, (0.6, 1.0), keep)
        best = _clearly_better(best, _of(found, sensors, False))
    if not best.parts and switched:
        found = _ranked(robot, setup, switched, explanations, rng, progress, (0.6, 1.0), keep)
        best = _clearly_better(best, _of(found, (), True))
    return best


def protocol(
    robot: Robot, setup: DriveSetup, seconds: float, rng: np.random.Generator
) -> tuple[tuple[Planned, ...], tuple[NotTestable, ...], frozenset[str]]:
    """Every motion once, for a robot without runs; the terms that none of them shows, and the effects that they show at
    no target."""
    planned = [within_limits(robot, setup, m, {}) for m in motions(setup, seconds, rng)]
    runs = [simulate_run(robot, setup, p.motion, {}, rng) for p in planned]
    data = build_dataset(runs, [robot] * len(runs), dict(setup.sigma))
    problem = build_problem(data, build_space(data, ()), data.sigma)
    hidden = not_testable(problem, fit_all(problem, [{}])[0], ())
    terms = {n.term for n in hidden}
    shown = {t.effect for t in problem.space.candidates if t not in terms}
    return tuple(planned), hidden, frozenset(t.effect for t in terms) - shown


def _clearly_better(simple: Experiment, other: Experiment) -> Experiment:
    """The one that asks for more only where it is worth that: where it parts further pairs, and by far."""
    before, after = _of_pairs(simple.losses), _of_pairs(other.losses)
    worth = (before < PARTS) & (after >= PARTS) & (after >= 2.0 * before)
    return other if bool(worth.any()) and parted(other.losses) > parted(simple.losses) else simple


def _of_pairs(losses: np.ndarray) -> np.ndarray:
    """(n (n - 1) / 2,) the smaller ratio of each pair, whichever of the two is true."""
    return np.asarray(np.minimum(losses, losses.T)[np.triu_indices(len(losses), 1)])


def parted(losses: np.ndarray) -> int:
    """How many pairs of explanations come apart, of (n, n) likelihood ratios."""
    return int(np.count_nonzero(_of_pairs(losses) >= PARTS))


def _told(losses: np.ndarray) -> tuple[int, int, float, float]:
    """What a motion is ranked by: the pairs that it parts; how many more it brings half of the way; the least ratio of
    those that it parts; and, where all that is equal, the least ratio of all. The ratio of a pair that no motion parts
    is noise and must not decide before."""
    pairs = _of_pairs(losses)
    clear = pairs[pairs >= PARTS]
    half_way = int(np.count_nonzero(pairs >= 0.5 * PARTS))
    return len(clear), half_way, float(clear.min(initial=np.inf)), float(pairs.min())


def _of(ranked: tuple[Separation, ...], sensors: tuple[str, ...], switches: bool) -> Experiment:
    """The best motion alone, or with as many more as help to part further pairs: not every motion shows everything."""
    played, left = [ranked[0]], list(ranked[1:])
    so_far = best = ranked[0].losses
    needed = 1  # of those that are played
    while so_far.min() < PARTS and left and len(played) < MOST:
        add = max(left, key=lambda s: _told(so_far + s.losses))
        played.append(add)
        left.remove(add)
        so_far = so_far + add.losses
        if _told(so_far)[0] > _told(best)[0]:
            needed, best = len(played), so_far
    return Experiment(ranked, tuple(played[:needed]), sensors, switches)


def _ranked(
    robot: Robot,
    setup: DriveSetup,
    tried: Sequence[Motion],
    explanations: Sequence[Values],
    rng: np.random.Generator,
    progress: Progress,
    share: tuple[float, float],
    keep: Keep,
) -> tuple[Separation, ...]:
    """Best first; share: of all the work that is behind at the begin and at the end."""
    found, (begin, end) = [], share
    for k, motion in enumerate(tried):
        progress(motion.name, begin + (end - begin) * k / len(tried))
        step = f"{','.join(setup.sigma)}: {motion.name}{', switched' if motion.enabled is not None else ''}"
        found.append(keep(step, partial(separation, robot, setup, motion, explanations, rng)))
    return tuple(sorted(found, key=lambda s: _told(s.losses), reverse=True))
