"""Drive badly and learn from it: runs of the nominal controller, their diagnosis, and networks taught on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plants.diff_drive import DiffDrive
from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.estimator import EstimatorSettings, build_filter
from residual_mpc.closed_loop.loop import LoopSettings, run_closed_loop
from residual_mpc.closed_loop.scenario import Progress, RunOptions
from residual_mpc.diagnosis.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import Made, Options, diagnose
from residual_mpc.diagnosis.gap import gap_of, measure_scales
from residual_mpc.diagnosis.replay import predict
from residual_mpc.export import Build, augment
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings, Values, assemble
from residual_mpc.residual.learn import LearnSettings
from residual_mpc.residual.record import Residual
from residual_mpc.residual.train import Task, train
from scenarios.scenario import DriveScenario

ROBOT = DiffDrive("rover", 0.033, 0.16)
NOISE = {"pose.x": 0.002, "pose.y": 0.002, "pose.theta": 0.006}  # m, m, rad; what the robot file says of the sensors
PRACTICE_SEED = 7_000  # far from the seeds that are scored


@dataclass(frozen=True, eq=False)
class Learned:
    """runs: the practice; made: their diagnosis; network: taught on the nominal model; rest: on the diagnosed one."""

    runs: tuple[Run, ...]
    made: Made
    network: Residual
    rest: Residual

    @property
    def effects(self) -> Values:
        return self.made.diagnosis.values

    def summary(self) -> dict[str, Any]:
        """What the diagnosis came to, for the result."""
        d = self.made.diagnosis
        named = [
            {
                "effect": c.term.effect,
                "target": c.term.target,
                "probability": c.probability,
                "parameters": {p.name: {"value": p.value, "ci95": list(p.ci95)} for p in c.parameters},
            }
            for c in d.causes
        ]
        shrink = None if d.achieved is None else {"value": d.achieved.value, "ci95": list(d.achieved.ci95)}
        return {"verdict": d.verdict, "before": d.gap.before, "after": d.gap.after, "shrink": shrink, "effects": named}


def practise(scenario: DriveScenario, options: RunOptions, progress: Progress) -> Learned:
    """Drive every motion of the practice once with the nominal MPC, diagnose the runs, teach the networks."""
    from controllers.mpc import build_mpc
    from controllers.settings import MpcSettings

    model = augment(ROBOT, {}, None, Build(scenario.dt))
    estimator, controller = build_filter(model, EstimatorSettings()), build_mpc(model, MpcSettings())
    runs = []
    for i, (reference, seconds) in enumerate(scenario.practice):
        progress("practice: driving with the nominal model", 0.1 * i / len(scenario.practice))
        episode = run_closed_loop(
            scenario.simulator(), estimator, controller, reference(), LoopSettings(seconds, scenario.dt),
            np.random.default_rng((PRACTICE_SEED, options.seed, i)), f"practice_{i}",
        )  # fmt: skip
        runs.append(episode.run())
    progress("practice: diagnosing the log", 0.1)
    robots = [ROBOT] * len(runs)
    made = diagnose(runs, robots, NOISE, (), Options(), np.random.default_rng(options.seed))
    progress("practice: teaching the networks", 0.35)
    log = tuple(runs)
    return Learned(log, made, teach(log, {}, options.seed), teach(log, made.diagnosis.values, options.seed))


def teach(runs: tuple[Run, ...], effects: Values, seed: int) -> Residual:
    """The paper's network, by its UKF, on top of the model with these effects."""
    task = Task(runs, (ROBOT,) * len(runs), NOISE, "real-to-dyn", effects)
    return train(task, LearnSettings(passes=2), np.random.default_rng(seed)).whole


def closed_loop_gap(episodes: Sequence[Episode], learned: Learned) -> dict[str, Any]:
    """The gap on what the effects' controller drove, before and after them, beside the shrink that was stated."""
    data = build_dataset([e.run() for e in episodes], [ROBOT] * len(episodes), NOISE)
    scales, everything = measure_scales(data), np.ones(data.count, dtype=bool)
    effects = assemble([learned.effects], {k.effect: ROBOT.slots(k.effect) for k in learned.effects})
    before, after = (
        float(gap_of(data, scales, data.y - predict(data, s)[0], everything).total) for s in (Settings(1), effects)
    )
    shrink = None if before == 0.0 else 1.0 - after / before
    return {"before": before, "after": after, "shrink": shrink, "stated": learned.summary()["shrink"]}
