"""Effects that no run can tell apart: late commands and late readings of the whole robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, robot_of
from oracles.rover_log import SIGMA, rover_run
from test_rivals import ROVER, rivals_of

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.space import Space
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Term

COMMANDS, READINGS = Term("command_delay", None), Term("sensor_delay", None)


def space_of(folder: Path, enabled: np.ndarray | None = None) -> Space:
    """Of an arm whose two joints move."""
    t = 0.02 * np.arange(400)
    columns = {f"{what}.j{k}": np.sin(t + k) for what in ("command", "position") for k in (1, 2)}
    if enabled is not None:
        columns |= {f"enabled.j{k}": enabled for k in (1, 2)}
    return build_space(build_dataset([Run("r", t, columns)], [robot_of(folder, arm_xml(SERVOS))], {}), ())


def test_only_one_of_them_may_be_in_a_set(tmp_path: Path) -> None:
    space = space_of(tmp_path)
    assert {COMMANDS, READINGS} <= set(space.candidates)
    assert not space.may_join(READINGS, (COMMANDS,))
    assert not space.may_join(COMMANDS, (Term("payload", None), READINGS))
    assert space.may_join(Term("sensor_delay", "j1"), (COMMANDS,))
    assert space.may_join(Term("payload", None), (COMMANDS,))


def test_a_change_of_one_may_stand_beside_the_other_in_both_sets(tmp_path: Path) -> None:
    space = space_of(tmp_path)
    assert space.may_join(READINGS._replace(changed=True), (COMMANDS,))
    assert not space.may_join(READINGS._replace(changed=True), (COMMANDS._replace(changed=True),))


def test_a_motor_that_is_switched_off_tells_them_apart(tmp_path: Path) -> None:
    on = np.ones(400)
    assert not space_of(tmp_path, on).may_join(READINGS, (COMMANDS,))
    on[150:180] = 0.0
    assert space_of(tmp_path, on).may_join(READINGS, (COMMANDS,))


@pytest.mark.parametrize("chosen", [COMMANDS, READINGS])
def test_whichever_is_found_stands_in_a_group_with_the_other(chosen: Term) -> None:
    delay = Knob(chosen.effect, None, "delay")
    only = ("command_delay", "sensor_delay", "track_width")
    found = rivals_of({"command_delay": {"delay": 0.08}}, {delay: 0.08}, only)
    assert ((COMMANDS,), (READINGS,)) in found.groups
    assert found.shares[COMMANDS] == pytest.approx(found.shares[READINGS])


def test_encoders_keep_the_delay_of_the_pose_apart() -> None:
    run = rover_run("r", {}, seed=0)
    wheels = {f"velocity.{w}": run.columns[f"command.{w}"] for w in ("left", "right")}
    data = build_dataset([Run("r", run.t, {**run.columns, **wheels})], [ROVER], SIGMA)
    assert build_space(data, ()).may_join(Term("sensor_delay", "pose"), (COMMANDS,))
