"""One of the paper's learning experiments, by name, as a scenario: it answers with the contract's `learn` object."""

from dataclasses import dataclass
from typing import Any

from residual_mpc.closed_loop.scenario import Progress, RunOptions
from scenarios.experiments.experiment import Experiment


@dataclass(frozen=True)
class LearningScenario:
    """An experiment that can be run by name; see residual_mpc.closed_loop.scenario.Scenario."""

    experiment: Experiment

    @property
    def name(self) -> str:
        return self.experiment.name

    @property
    def summary(self) -> str:
        return self.experiment.summary

    def run(self, options: RunOptions, progress: Progress) -> dict[str, Any]:
        """Every seed is another robot under another noise."""
        import numpy as np
        from threadpoolctl import threadpool_limits

        from scenarios.experiments.document import document
        from scenarios.experiments.figure import draw
        from scenarios.experiments.setting import learn

        experiment = self.experiment
        done: dict[str, list[Any]] = {form: [] for form in experiment.forms}
        with threadpool_limits(1):
            for i in range(options.seeds):
                for form in experiment.forms:
                    seed = options.seed + i
                    progress(f"robot {i + 1} of {options.seeds}", i / options.seeds)
                    setting = experiment.build(form, seed, experiment.settings.low_pass)
                    done[form].append(learn(setting, experiment.settings, np.random.default_rng(seed)))
        result = document(experiment, done)
        if options.out is not None:
            progress("drawing", 0.98)
            options.out.mkdir(parents=True, exist_ok=True)
            draw(experiment, done, options.out / f"{experiment.name}.png")
            result["figure"] = str(options.out / f"{experiment.name}.png")
        return result
