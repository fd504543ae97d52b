"""Times that are the log's: commands that act before their stamps, and speeds that are means over a sample."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.references import BETWEEN, measure_references
from residual_mpc.diagnosis.predict.replay import beyond
from residual_mpc.diagnosis.results.intervals import _of_mean_speeds
from residual_mpc.effects.command import delay_sequence, delay_start, delay_step
from residual_mpc.effects.ops import NUMPY
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob

ROVER = DiffDrive("rover", 0.033, 0.16)
DELAY, LEFT = Knob("command_delay", None, "delay"), Knob("command_delay", "left", "delay")
EVERY = 5  # commands of the controller to one row of the log


def thinned(run: Run) -> Run:
    """Every so many rows of a run, the latest of each."""
    rows = slice(EVERY - 1, None, EVERY)
    return Run(run.name, run.t[rows] - run.t[rows][0], {k: v[rows] for k, v in run.columns.items()})


def test_commands_are_shifted_forward_in_a_replay_and_not_in_a_controller() -> None:
    u = np.random.default_rng(0).standard_normal((1, 30, 2))
    early = delay_sequence({"delay": np.array([[-0.025, 0.0]])}, u, 0.01)
    at = np.minimum(np.arange(30) + 2.5, 29.0)
    np.testing.assert_allclose(early[0, :, 0], np.interp(at, np.arange(30), u[0, :, 0]))
    np.testing.assert_array_equal(early[..., 1], u[..., 1])
    memory = delay_start(NUMPY, {}, u[0, 0], 0.01)
    out, _ = delay_step(NUMPY, {"delay": np.array([-0.025, 0.0])}, memory, u[0, 1], 0.01)
    np.testing.assert_array_equal(out, u[0, 1])


@pytest.mark.parametrize(("held", "expected"), [(1, 0.05), (20, 0.0)])
def test_only_smooth_commands_may_have_been_sent_more_often(held: int, expected: float) -> None:
    """held: rows of 50 ms in which a command stays as it is."""
    run = rover_run("r", {}, 12.0)
    rows = np.arange(len(run.t)) // held * held
    commands = {k: v[rows] for k, v in run.columns.items() if k.startswith("command.")}
    data = build_dataset([Run(run.name, run.t, {**run.columns, **commands})], [ROVER], SIGMA)
    assert measure_references(data)[BETWEEN] == pytest.approx(expected)
    space = build_space(data, ())
    assert space.bounds(DELAY)[0] == pytest.approx(-0.5 * expected) and space.bounds(LEFT)[0] == 0.0


@pytest.mark.parametrize(("delay", "expected"), [(-0.02, 0.02), (0.02, 0.0), (0.0, 0.0)])
def test_the_replay_knows_the_commands_behind_a_window(delay: float, expected: float) -> None:
    data = build_dataset([rover_run("r", {}, 12.0)], [ROVER], SIGMA)
    row = build_space(data, ()).settings([{DELAY: delay}])
    assert beyond(data.blocks[0], row) == pytest.approx(expected)


def test_a_thinner_log_is_named_as_that() -> None:
    """Rows of 50 ms, of commands every 10 ms: the logged one is 20 ms older than the mean of those that act."""
    runs = [thinned(rover_run(f"r{seed}", {}, 16.0, rate=100.0, seed=seed)) for seed in range(3)]
    options = Options(only=("command_delay", "sensor_delay", "track_width"))
    found = diagnose(runs, [ROVER] * 3, SIGMA, (), options, np.random.default_rng(0)).diagnosis
    (cause,) = found.causes
    assert cause.term.effect == "command_delay" and not found.groups
    assert cause.parameters[0].value == pytest.approx(-0.02, abs=0.003)
    assert any("before their stamps" in note for note in found.notes)


@pytest.mark.parametrize(
    ("channel", "delay", "expected"),
    [("velocity.left", 0.03, {DELAY: (0.02,)}), ("velocity.left", -0.01, {}), ("pose.x", 0.03, {})],
)
def test_logged_speeds_may_be_means_over_a_sample(channel: str, delay: float, expected: dict[Knob, Any]) -> None:
    data = SimpleNamespace(
        channels=("twist.theta", channel), compared=np.array([[False, True]]), runs=[SimpleNamespace(period=0.02)]
    )
    of: Any = SimpleNamespace(raw=data, final=SimpleNamespace(values={DELAY: delay}))
    found = _of_mean_speeds(of)
    assert {k: pytest.approx(v) for k, v in found.items()} == expected
