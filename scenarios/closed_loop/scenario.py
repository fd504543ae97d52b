"""What a closed-loop experiment is: a robot that is not what its model says, a path, controllers on equal terms.

    drive badly (nominal model, several motions) -> diagnose the log -> put the diagnosis in the controller -> drive

Only the oracle is told what was withheld.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from residual_mpc.closed_loop.scenario import Progress, RunOptions

if TYPE_CHECKING:
    from residual_mpc.closed_loop.protocols import Reading, Reference, Simulator
    from scenarios.closed_loop.robot_setup import RobotSetup

Withheld = Mapping[tuple[str, str | None, str], float]  # (effect, target, parameter) -> true value


@dataclass(frozen=True)
class ClosedLoop:
    """A robot in a physics engine, under the controllers of the contract.

    setup: the robot as its model has it. simulator: makes the real one (in `plant`'s engine). withheld: what the oracle
    knows of it. reference: makes the path; where the robot's poses are not what is tracked, it has a `begin()` too, the
    poses by channel at its start. training_motions: those that the nominal controller drives for the log that is
    diagnosed, with their seconds. limits: soft ones, (channel, lower, upper) in m or rad. speed: m/s, about as fast as
    the path.
    """

    name: str
    summary: str
    plant: str
    setup: "Callable[[], RobotSetup]"
    simulator: "Callable[[], Simulator]"
    withheld: Withheld
    reference: "Callable[[], Reference]"
    seconds: float = 20.0
    dt: float = 0.05
    limits: tuple[tuple[str, float, float], ...] = ()
    speed: float = 0.2
    training_motions: "tuple[tuple[Callable[[], Reference], float], ...]" = field(default=())

    def run(self, options: RunOptions, progress: Progress) -> dict[str, Any]:
        """The contract's `run` object, with the diagnosis that the controllers were given beside it."""
        import numpy as np

        from residual_mpc.closed_loop.compare import compare, document
        from residual_mpc.closed_loop.loop import LoopSettings
        from scenarios.closed_loop.controllers import controllers, seeds_of
        from scenarios.closed_loop.results import write
        from scenarios.closed_loop.training_runs import closed_loop_gap, drive_training_runs

        progress("recording: driving with the nominal model", 0.0)
        setup, reference = self.setup(), self.reference()
        learned = drive_training_runs(self, setup, options, progress)
        progress("building the controllers", 0.4)
        rivals = controllers(self, setup, learned, options)
        comparison = compare(
            self.simulator(), rivals, reference, LoopSettings(self.seconds, self.dt), seeds_of(options),
            self.limits, lambda stage, done: progress(stage, 0.45 + 0.5 * done), start_reading(reference),
        )  # fmt: skip
        result = document(comparison, self.name, self.plant, np.random.default_rng(options.seed))
        result["controller"] = options.controller
        result["diagnosis"] = learned.summary()
        result["closed_loop_gap"] = closed_loop_gap(comparison.episodes["effects"], learned, setup)
        if options.out is not None:
            progress("writing episodes and figures", 0.97)
            result["files"] = write(options.out, self, comparison, learned, result)
        return result

    def shorter(self, seconds: float) -> "ClosedLoop":
        """The same experiment, driven for less long."""
        return replace(self, seconds=seconds)


def start_reading(reference: "Reference") -> "Reading | None":
    """Where a robot begins; None: at the path's first pose."""
    begin = getattr(reference, "begin", None)
    return None if begin is None else begin()
