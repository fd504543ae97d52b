"""Drive badly and learn from it: runs of the nominal controller, their diagnosis, and networks taught on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.estimator import build_filter
from residual_mpc.closed_loop.loop import LoopSettings, run_closed_loop
from residual_mpc.closed_loop.scenario import Progress, RunOptions
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.export import Build, augment
from residual_mpc.learning.network.residual import Residual
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings, Values, assemble
from scenarios.closed_loop.robot_setup import RobotSetup
from scenarios.closed_loop.task import ClosedLoopTask, start_reading

PRACTICE_SEED = 7_000  # far from the seeds that are scored


@dataclass(frozen=True, eq=False)
class TrainingOutcome:
    """made: their diagnosis; network: taught on the nominal model; rest: on the diagnosed one."""

    runs: tuple[Run, ...]
    made: DiagnosisResult
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


def drive_training_runs(
    task: ClosedLoopTask, setup: RobotSetup, options: RunOptions, progress: Progress
) -> TrainingOutcome:
    """Drive every training motion once with the nominal MPC, diagnose the runs, teach the networks."""
    log = recorded(task, setup, options, progress)
    progress("diagnosing the log", 0.1)
    made = diagnosed(log, setup, options)
    progress("training the networks", 0.35)
    on_top = setup.teach(log, made.diagnosis.values, options.seed)
    return TrainingOutcome(log, made, setup.teach(log, {}, options.seed), on_top)


def recorded(task: ClosedLoopTask, setup: RobotSetup, options: RunOptions, progress: Progress) -> tuple[Run, ...]:
    """Every training motion driven once with the nominal MPC."""
    from controllers.mpc import build_mpc

    model = augment(setup.robot, {}, None, Build(task.dt))
    estimator, controller = build_filter(model, setup.estimator), build_mpc(model, setup.control)
    runs = []
    for i, (make, seconds) in enumerate(task.training_motions):
        progress("recording: driving with the nominal model", 0.1 * i / len(task.training_motions))
        reference = make()
        episode = run_closed_loop(
            task.simulator(), estimator, controller, reference, LoopSettings(seconds, task.dt),
            np.random.default_rng((PRACTICE_SEED, options.seed, i)), f"practice_{i}", at=start_reading(reference),
        )  # fmt: skip
        runs.append(episode.run())
    return tuple(runs)


def diagnosed(runs: Sequence[Run], setup: RobotSetup, options: RunOptions) -> DiagnosisResult:
    """The diagnosis of these runs, which is told nothing of what is withheld."""
    rng = np.random.default_rng(options.seed)
    return diagnose(runs, [setup.robot] * len(runs), dict(setup.noise), (), Options(), rng)


def closed_loop_gap(episodes: Sequence[Episode], learned: TrainingOutcome, setup: RobotSetup) -> dict[str, Any]:
    """The gap on what the effects' controller drove, before and after them, beside the shrink that was stated."""
    data = build_dataset([e.run() for e in episodes], [setup.robot] * len(episodes), setup.noise)
    scales, everything = measure_scales(data), np.ones(data.count, dtype=bool)
    effects = assemble([learned.effects], {k.effect: setup.robot.slots(k.effect) for k in learned.effects})
    before, after = (
        float(gap_of(data, scales, data.y - predict(data, s)[0], everything).total) for s in (Settings(1), effects)
    )
    shrink = None if before == 0.0 else 1.0 - after / before
    return {"before": before, "after": after, "shrink": shrink, "stated": learned.summary()["shrink"]}
