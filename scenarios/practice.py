"""Drive badly and learn from it: runs of the nominal controller, their diagnosis, and networks taught on them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.estimator import build_filter
from residual_mpc.closed_loop.loop import LoopSettings, run_closed_loop
from residual_mpc.closed_loop.scenario import Progress, RunOptions
from residual_mpc.diagnosis.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.gap import gap_of, measure_scales
from residual_mpc.diagnosis.opened import Made
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.replay import predict
from residual_mpc.export import Build, augment
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings, Values, assemble
from residual_mpc.residual.record import Residual
from scenarios.kit import Kit
from scenarios.scenario import ClosedLoop, beginning

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


def practise(scenario: ClosedLoop, kit: Kit, options: RunOptions, progress: Progress) -> Learned:
    """Drive every motion of the practice once with the nominal MPC, diagnose the runs, teach the networks."""
    from controllers.mpc import build_mpc

    model = augment(kit.robot, {}, None, Build(scenario.dt))
    estimator, controller = build_filter(model, kit.estimator), build_mpc(model, kit.control)
    runs = []
    for i, (make, seconds) in enumerate(scenario.practice):
        progress("recording: driving with the nominal model", 0.1 * i / len(scenario.practice))
        reference = make()
        episode = run_closed_loop(
            scenario.simulator(), estimator, controller, reference, LoopSettings(seconds, scenario.dt),
            np.random.default_rng((PRACTICE_SEED, options.seed, i)), f"practice_{i}", at=beginning(reference),
        )  # fmt: skip
        runs.append(episode.run())
    progress("diagnosing the log", 0.1)
    robots = [kit.robot] * len(runs)
    made = diagnose(runs, robots, dict(kit.noise), (), Options(), np.random.default_rng(options.seed))
    progress("training the networks", 0.35)
    log = tuple(runs)
    on_top = kit.teach(log, made.diagnosis.values, options.seed)
    return Learned(log, made, kit.teach(log, {}, options.seed), on_top)


def closed_loop_gap(episodes: Sequence[Episode], learned: Learned, kit: Kit) -> dict[str, Any]:
    """The gap on what the effects' controller drove, before and after them, beside the shrink that was stated."""
    data = build_dataset([e.run() for e in episodes], [kit.robot] * len(episodes), kit.noise)
    scales, everything = measure_scales(data), np.ones(data.count, dtype=bool)
    effects = assemble([learned.effects], {k.effect: kit.robot.slots(k.effect) for k in learned.effects})
    before, after = (
        float(gap_of(data, scales, data.y - predict(data, s)[0], everything).total) for s in (Settings(1), effects)
    )
    shrink = None if before == 0.0 else 1.0 - after / before
    return {"before": before, "after": after, "shrink": shrink, "stated": learned.summary()["shrink"]}
