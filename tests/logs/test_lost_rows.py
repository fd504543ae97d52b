"""Rows that a log has lost come back without measurements, and with the commands that were likely sent in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.logs.lost_rows import with_lost_rows
from residual_mpc.logs.run import FloatArray, Run

RATE = 50.0


def whole(seed: int, jitter: float = 0.0, stepped: bool = False) -> Run:
    """A run of 10 s with no row lost; stepped: its command stands for half a second at a time."""
    rng = np.random.default_rng(seed)
    n = int(10.0 * RATE)
    t = (np.arange(n) + np.clip(jitter * rng.standard_normal(n), -0.4, 0.4)) / RATE
    u = np.sin(1.3 * t) + 0.4 * np.sin(3.1 * t + 1.0)
    if stepped:
        u = np.sign(np.sin(2.0 * np.pi * t + 0.1))
    columns = {"command.j": u, "enabled.j": np.ones(n), "position.j": 0.9 * u + 1e-3 * rng.standard_normal(n)}
    return Run("r", t - t[0], columns, extra_columns={"current": np.abs(u)})


def less(run: Run, share: float, seed: int) -> tuple[Run, FloatArray]:
    """The run without some of its rows, and which it kept (n,) bool."""
    kept = np.random.default_rng(seed).uniform(size=len(run.t)) >= share
    kept[[0, 1, -2, -1]] = True
    columns = {name: values[kept] for name, values in run.columns.items()}
    extra = {name: values[kept] for name, values in run.extra_columns.items()}
    return replace(run, t=run.t[kept], columns=columns, extra_columns=extra), kept


@pytest.mark.parametrize("jitter", [0.0, 0.1])
@pytest.mark.parametrize("share", [0.01, 0.1])
def test_lost_commands_are_interpolated(jitter: float, share: float) -> None:
    run = whole(1, jitter)
    lossy, kept = less(run, share, 2)
    (filled,), (finding,) = with_lost_rows([lossy])
    assert len(filled.t) == len(run.t) and f"{(~kept).sum()} of {len(run.t)} rows" in finding.message
    assert np.abs(filled.t - run.t).max() < 3.0 * jitter / RATE + 1e-9
    assert filled.t[kept] == pytest.approx(lossy.t)
    command = run.columns["command.j"]
    held = command[np.maximum.accumulate(np.where(kept, np.arange(len(kept)), 0))]
    error = np.abs(filled.columns["command.j"] - command)
    assert error[~kept].mean() < (0.05 if jitter == 0.0 else 0.3) * np.abs(held - command)[~kept].mean()
    assert np.isnan(filled.columns["position.j"][~kept]).all()
    assert np.isnan(filled.extra_columns["current"][~kept]).all()
    assert np.array_equal(filled.columns["position.j"][kept], lossy.columns["position.j"])
    assert (filled.columns["enabled.j"] == 1.0).all()


def test_a_command_that_steps_is_held() -> None:
    lossy, kept = less(whole(3, stepped=True), 0.1, 4)
    filled = with_lost_rows([lossy])[0][0]
    assert set(np.unique(filled.columns["command.j"])) == {-1.0, 1.0}


def test_a_whole_log_stays() -> None:
    run = whole(5, 0.1)
    assert with_lost_rows([run]) == ((run,), ())


def test_a_loop_that_is_late_has_lost_nothing() -> None:
    run = whole(10)
    late = np.where(np.random.default_rng(11).uniform(size=len(run.t)) < 0.05, 0.6 / RATE, 0.0)
    run = replace(run, t=run.t + np.cumsum(late))
    assert with_lost_rows([run])[0][0] is run


def test_a_pause_is_not_filled() -> None:
    run = whole(6)
    kept = (run.t < 4.0) | (run.t > 4.5)
    columns = {name: values[kept] for name, values in run.columns.items()}
    paused = Run("r", run.t[kept], columns)
    assert with_lost_rows([paused])[0][0] is paused


def test_logs_that_are_not_written_evenly_stay() -> None:
    run = whole(7)
    rng = np.random.default_rng(8)
    uneven = replace(run, t=np.cumsum(rng.exponential(1.0 / RATE, len(run.t))))
    every_third = replace(run, t=run.t + 0.7 / RATE * (np.arange(len(run.t)) % 3 == 1))
    joined, _ = less(run, 0.1, 9)
    half = joined.columns["position.j"].copy()
    half[::2] = np.nan
    joined = replace(joined, columns={**joined.columns, "position.j": half})
    assert with_lost_rows([uneven, every_third, joined])[0] == (uneven, every_third, joined)
