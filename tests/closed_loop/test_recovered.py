"""The share of the oracle's advantage that a controller recovers, over seeds that all controllers drive."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.closed_loop.compare import recovered

SEEDS = 30


def driven(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tracking errors (SEEDS,) m of nominal, one in between and oracle: a seed that is hard is hard for all."""
    hard = rng.uniform(0.8, 1.2, SEEDS)
    noise = 1.0 + 0.1 * rng.standard_normal((3, SEEDS))
    nominal, mine, oracle = hard * noise * np.array([[0.05], [0.02], [0.01]])
    return nominal, mine, oracle


def test_the_share_is_1_for_the_oracle_and_0_for_the_nominal_controller() -> None:
    nominal, _, oracle = driven(np.random.default_rng(0))
    for mine, share in ((oracle, 1.0), (nominal, 0.0)):
        found = recovered(nominal, mine, oracle, np.random.default_rng(1))
        assert found is not None
        assert [found["value"], *found["ci95"]] == pytest.approx([share] * 3)


def test_its_interval_is_as_wide_as_the_share_scatters() -> None:
    """Among sets of seeds drawn anew."""
    rng = np.random.default_rng(2)
    found = [f for _ in range(60) if (f := recovered(*driven(rng), rng)) is not None]
    half = np.mean([0.5 * (f["ci95"][1] - f["ci95"][0]) for f in found])
    spread = 1.96 * np.std([f["value"] for f in found], ddof=1)
    assert len(found) == 60 and 0.7 < half / spread < 1.4
    assert np.mean([f["ci95"][0] < 0.75 < f["ci95"][1] for f in found]) > 0.85


def test_there_is_no_share_of_an_advantage_that_is_not_there() -> None:
    nominal, mine, _ = driven(np.random.default_rng(3))
    assert recovered(nominal, mine, 0.99 * nominal, np.random.default_rng(4)) is None
