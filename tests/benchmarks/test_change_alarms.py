"""The benchmark of false alarms, on estimates drawn directly."""

from __future__ import annotations

import numpy as np
from click.testing import CliRunner

from benchmarks.change_alarms import Untouched, change_alarms, division
from residual_mpc.comparison.contrast import Estimates
from residual_mpc.comparison.units import Units
from residual_mpc.models.settings import Term

RUN = np.repeat(np.arange(10), 3)


def untouched(of_runs: float, rng: np.random.Generator) -> Untouched:
    """Ten runs, of which those before and after differ by nothing but what every run has of its own."""
    shape = (len(RUN), 2 * 20 + 1)
    score = of_runs * rng.standard_normal((10, shape[1]))[RUN] + rng.standard_normal(shape)
    probes = tuple((Term("track_width", None, True), {}) for _ in range(20))
    estimates = Estimates(np.ones(shape), score, np.ones(shape), probes)
    return Untouched(Units(np.arange(30), RUN >= 5, RUN, np.zeros((30, 0))), np.zeros((30, 0)), estimates)


def test_divisions_of_untouched_runs_are_alarms_at_the_level() -> None:
    rng = np.random.default_rng(1)
    p = np.array([division(untouched(2.0, rng), rng) for _ in range(60)])
    assert (p <= 0.1).mean() <= 0.1 + 2.0 * np.sqrt(0.1 * 0.9 / 60)
    assert len(np.unique(p)) > 20


def test_a_recording_that_is_absent_is_named(tmp_path: object) -> None:
    done = CliRunner().invoke(change_alarms, ["--shared", str(tmp_path), "--source", "xl330"])
    assert done.exit_code == 0 and "xl330" in done.output and "absent" in done.output
