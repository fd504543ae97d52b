"""Which effect changed: the comparison of the reference's runs with the stream since the change."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from residual_mpc.comparison.compare import compare as run_comparison
from residual_mpc.comparison.document import to_document
from residual_mpc.comparison.prepare import ComparisonInput
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.diagnosis.options import Options
from residual_mpc.logs.run import Run
from residual_mpc.monitoring.model import RobotOf
from residual_mpc.report.comparison import comparison_sentence

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class CauseFinder:
    """Names what differs between two sets of runs. noise_of: as the robot file states it for runs of these names."""

    robot_of: RobotOf
    noise_of: Callable[[Sequence[str]], Mapping[str, float]]
    tunable: tuple[str, ...]
    options: Options
    progress: Progress = lambda stage, done: None

    def find(self, before: Sequence[Run], after: Sequence[Run], rng: np.random.Generator) -> dict[str, Any]:
        """comparison.json. Raises BadInput where a set is too short."""
        runs = (*before, *after)
        names = [r.name for r in runs]
        given = ComparisonInput(
            _named(before, "reference/"), _named(after, "stream/"), tuple(self.robot_of(n) for n in names),
            self.noise_of(names), self.tunable, self.options,
        )  # fmt: skip
        document = to_document(run_comparison(given, ComparisonSettings(), rng, self.progress))
        document["verdict_sentence"] = comparison_sentence(document)
        return document


def _named(runs: Sequence[Run], prefix: str) -> tuple[Run, ...]:
    """With names that differ."""
    count: Counter[str] = Counter()
    out = []
    for run in runs:
        count[run.name] += 1
        again = f"/{count[run.name]}" if count[run.name] > 1 else ""
        out.append(replace(run, name=f"{prefix}{run.name}{again}"))
    return tuple(out)
