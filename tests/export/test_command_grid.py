"""Commands on a model's own steps: those of a time step that is no multiple of it come at the right time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of

from residual_mpc.export import Build, augment
from residual_mpc.export.command_grid import CommandGrid
from residual_mpc.export.moving import moving_apart


def test_a_whole_number_of_steps_repeats_a_command() -> None:
    u = np.random.default_rng(0).standard_normal((3, 7, 2))
    grid = CommandGrid(0.02, 0.002)
    np.testing.assert_array_equal(grid.commands(u), np.repeat(u, 10, axis=1))
    nodes = np.arange(71.0)[None]
    assert [float(grid.at_sample(nodes, k)[0]) for k in range(8)] == [10.0 * k for k in range(8)]


def test_between_steps_the_time_is_kept() -> None:
    grid, u = CommandGrid(0.005, 0.002), np.arange(8.0)[None, :, None]
    commands = grid.commands(u)[0, :, 0]
    assert len(commands) == 20  # 40 ms
    middle = 0.002 * (np.arange(20) + 0.5)
    assert (np.abs(commands - middle / 0.005) <= 1.0 + 1e-9).all()
    nodes = 0.002 * np.arange(21.0)[None]  # the time itself
    for k in range(9):
        assert grid.at_sample(nodes, k)[0] == pytest.approx(0.005 * k, abs=1e-12)


@pytest.mark.parametrize("dt", [0.004, 0.005, 0.007])
def test_a_step_lies_near_the_replay_at_any_time_step(tmp_path: Path, dt: float) -> None:
    """The replay of this arm takes steps of 2 ms."""
    model = augment(robot_of(tmp_path, arm_xml()), {}, None, Build(dt))
    assert moving_apart(model, np.random.default_rng(0)) < 2e-3
