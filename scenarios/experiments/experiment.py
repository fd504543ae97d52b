"""One of the paper's learning experiments, by name, as a scenario: it answers with the contract's `learn` object."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from residual_mpc.closed_loop.scenario import Progress, RunOptions

if TYPE_CHECKING:
    from residual_mpc.learning.stream.updates import StreamSettings
    from scenarios.experiments.setting import Setting

Build = Callable[[str, int, float], "Setting"]  # form, seed, s of the low pass


@dataclass(frozen=True)
class Experiment:
    """case, plant: as in the result. build: records the robots of a seed and learns what comes before. forms: of the
    residual; the first one is the result, the others stand beside it. labels: of the components, with their units.
    minutes: of data that the paper needed. jumps: whether the reference has spikes, to be left out of the figures."""

    name: str
    summary: str
    case: str
    plant: str
    build: Build
    settings: "StreamSettings"
    forms: tuple[str, ...]
    labels: tuple[str, str, str]
    minutes: float
    jumps: bool = False

    def run(self, options: RunOptions, progress: Progress) -> dict[str, Any]:
        """Every seed is another robot under another noise."""
        import numpy as np
        from threadpoolctl import threadpool_limits

        from scenarios.experiments.document import document
        from scenarios.experiments.figure import draw
        from scenarios.experiments.setting import learn

        done: dict[str, list[Any]] = {form: [] for form in self.forms}
        with threadpool_limits(1):
            for i in range(options.seeds):
                for form in self.forms:
                    seed = options.seed + i
                    progress(f"robot {i + 1} of {options.seeds}", i / options.seeds)
                    setting = self.build(form, seed, self.settings.low_pass)
                    done[form].append(learn(setting, self.settings, np.random.default_rng(seed)))
        result = document(self, done)
        if options.out is not None:
            progress("drawing", 0.98)
            options.out.mkdir(parents=True, exist_ok=True)
            draw(self, done, options.out / f"{self.name}.png")
            result["figure"] = str(options.out / f"{self.name}.png")
        return result
