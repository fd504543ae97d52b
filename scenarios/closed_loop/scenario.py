"""A closed-loop experiment as a scenario: a robot that is not what its model says, a path, controllers on equal terms.

    drive badly (nominal model, several motions) -> diagnose the log -> put the diagnosis in the controller -> drive

Only the oracle is told what was withheld.
"""

from dataclasses import dataclass
from typing import Any

from residual_mpc.closed_loop.scenario import Progress, RunOptions
from scenarios.closed_loop.task import ClosedLoopTask, start_reading


@dataclass(frozen=True)
class ClosedLoop:
    """A task that can be run by name; see residual_mpc.closed_loop.scenario.Scenario."""

    task: ClosedLoopTask

    @property
    def name(self) -> str:
        return self.task.name

    @property
    def summary(self) -> str:
        return self.task.summary

    def run(self, options: RunOptions, progress: Progress) -> dict[str, Any]:
        """The contract's `run` object, and with it the diagnosis that the controllers were built from."""
        import numpy as np

        from residual_mpc.closed_loop.compare import compare, document
        from residual_mpc.closed_loop.loop import LoopSettings
        from scenarios.closed_loop.controllers import controllers, seeds_of
        from scenarios.closed_loop.results import write
        from scenarios.closed_loop.training_runs import closed_loop_gap, drive_training_runs

        task = self.task
        progress("recording: driving with the nominal model", 0.0)
        setup, reference = task.setup(), task.reference()
        learned = drive_training_runs(task, setup, options, progress)
        progress("building the controllers", 0.4)
        rivals = controllers(task, setup, learned, options)
        comparison = compare(
            task.simulator(), rivals, reference, LoopSettings(task.seconds, task.dt), seeds_of(options),
            task.limits, lambda stage, done: progress(stage, 0.45 + 0.5 * done), start_reading(reference),
        )  # fmt: skip
        result = document(comparison, task.name, task.plant, np.random.default_rng(options.seed))
        result["controller"] = options.controller
        result["diagnosis"] = learned.summary()
        result["closed_loop_gap"] = closed_loop_gap(comparison.episodes["effects"], learned, setup)
        if options.out is not None:
            progress("writing episodes and figures", 0.97)
            result["files"] = write(options.out, task, setup.robot, comparison, learned, result)
        return result
