"""Held-out windows that are driven unlike those of the fit are told from commands alone, and widen what is expected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.unlike_motions import unlike_share
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.shrink import expected_shrink

ROVER = DiffDrive("rover", 0.033, 0.16)


def windows(seeds: range, times: float = 1.0, off: bool = False) -> Dataset:
    """Windows of rovers; times: factor on their commands, off: whether their motors are off throughout."""
    runs = [rover_run(f"r{k}", {}, seed=k) for k in seeds]
    data = build_dataset(runs, [ROVER] * len(runs), SIGMA)
    blocks = []
    for block in data.blocks:
        drive = replace(block.drive, command=times * block.drive.command)
        enabled = np.zeros((len(drive.clock), drive.steps, 2)) if off else None
        blocks.append(replace(block, drive=replace(drive, enabled=enabled)))
    return replace(data, blocks=tuple(blocks))


@pytest.mark.parametrize(
    ("times", "off", "low", "high"),
    [(1.0, False, 0.0, 0.1), (3.0, False, 0.5, 1.0), (1.0, True, 1.0, 1.0)],
)
def test_what_is_driven_unlike_all_others(times: float, off: bool, low: float, high: float) -> None:
    share = unlike_share(windows(range(4)), windows(range(10, 13), times, off), DataSettings())
    assert low <= share <= high


def test_stretches_of_one_run_are_like_its_others() -> None:
    data = windows(range(1))
    held = np.arange(data.count) % 4 == 3
    assert unlike_share(data.take(~held), data.take(held), DataSettings()) < 0.2


def test_few_windows_say_nothing() -> None:
    data = windows(range(2))
    assert unlike_share(data.take(np.arange(data.count) < 8), windows(range(3, 4), 9.0), DataSettings()) == 0.0
    assert unlike_share(data, data.take(np.zeros(data.count, dtype=bool)), DataSettings()) == 0.0


def test_they_may_not_shrink_at_all() -> None:
    data, settings = windows(range(4)), ResultSettings()
    rng = np.random.default_rng(0)
    error = 0.01 * rng.standard_normal(data.y.shape)
    usual, off = (
        expected_shrink(data, held, measure_scales(data), error, 0.4 * error, np.random.default_rng(1), settings)
        for held in (windows(range(10, 13)), windows(range(10, 13), off=True))
    )
    assert usual.value == off.value == pytest.approx(0.6) and usual.ci95[0] == pytest.approx(0.6, abs=0.02)
    assert off.ci95 == (0.0, usual.ci95[1])
