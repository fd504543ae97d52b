"""A joint that something stops, told from one that sticks, lags or rests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from run_tables import ARM, arm_run

from residual_mpc.logs.audit import RobotFacts
from residual_mpc.logs.audit.stops import check_stops
from residual_mpc.logs.run import FloatArray, Run

Bend = Callable[[FloatArray], FloatArray]


def bent(bend: Bend, seed: int = 0) -> Run:
    """An arm's run in which joint b goes where `bend` sends its position."""
    run = arm_run(np.random.default_rng(seed), seconds=60.0)
    noise = 0.0005 * np.random.default_rng(seed + 1).standard_normal(len(run.t))
    return replace(run, columns={**run.columns, "position.b": bend(run.columns["command.b"]) + noise})


def stuck(u: FloatArray, band: float = 0.15) -> FloatArray:
    """Dry friction: the joint stays within `band` of its command and moves no more than it must."""
    y = np.empty_like(u)
    at = u[0]
    for k, x in enumerate(u):
        at = min(max(at, x - band), x + band)
        y[k] = at
    return y


@pytest.mark.parametrize(("side", "end"), [(-1.0, -0.3), (1.0, 0.45)])
def test_a_stop_is_found_where_it_is(side: float, end: float) -> None:
    found = check_stops([bent(lambda u: side * np.minimum(side * u, side * end))], ARM)
    assert [(f.kind, f.severity, f.column, f.run) for f in found] == [("stop", "warning", "position.b", "run")]
    assert f"stays at {end:.3g}"[:13] in found[0].message and found[0].row is not None


@pytest.mark.parametrize(
    "bend", [lambda u: u, lambda u: 0.6 * u, stuck, lambda u: 0.0 * u + 0.2], ids=["follows", "weak", "sticks", "rests"]
)
def test_what_follows_sticks_or_rests_is_not_stopped(bend: Bend) -> None:
    assert check_stops([bent(bend, seed) for seed in range(3)], ARM) == []


def test_an_end_that_the_model_has_is_none_to_speak_of() -> None:
    run = bent(lambda u: np.maximum(u, -0.3))
    known = RobotFacts(ARM.actuators, ARM.channels, limits={**ARM.limits, "b": (-0.31, 2.0)})
    assert check_stops([run], known) == []


def test_a_motor_that_is_off_is_not_stopped() -> None:
    run = bent(lambda u: np.maximum(u, -0.3))
    off = np.where(run.columns["command.b"] < -0.3, 0.0, 1.0)
    assert check_stops([replace(run, columns={**run.columns, "enabled.b": off})], ARM) == []
