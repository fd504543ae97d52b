"""A servo behind a gear: its command is the joint's position times the gear, and neither sign nor unit is wrong."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from init.arm_logs import KP, KV, mjcf, simulate, write

from residual_mpc.api.check import check
from residual_mpc.api.robot import load_robot
from residual_mpc.init.draft import draft


@pytest.fixture(scope="module")
def recorded() -> pd.DataFrame:
    return simulate()


def geared(folder: Path, gear: float) -> Path:
    """The arm whose elbow is the same servo seen from before a gear."""
    plain = f'<position name="elbow" joint="elbow" kp="{KP[1]}" kv="{KV[1]}"/>'
    behind = f'<position name="elbow" joint="elbow" kp="{KP[1] / gear**2}" kv="{KV[1] / gear**2}" gear="{gear}"/>'
    assert plain in mjcf()
    path = folder / "arm.xml"
    path.write_text(mjcf().replace(plain, behind))
    return path


@pytest.mark.parametrize("gear", [-1.0, 57.0])
def test_a_gear_is_no_fault_of_the_log(tmp_path: Path, recorded: pd.DataFrame, gear: float) -> None:
    model = geared(tmp_path, gear)
    log = write(tmp_path, recorded.assign(**{"command.elbow": gear * recorded["command.elbow"]}))
    found = draft(model, [log])
    assert found.mends == ()
    assert check(load_robot(model), [log]).usable


def test_a_share_of_a_motors_torque_has_no_unit(tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(mjcf("motor").replace("<motor ", '<motor gear="24" ctrlrange="-1 1" '))
    recorded = simulate("motor")
    sent = [c for c in recorded if c.startswith("command.")]
    found = draft(model, [write(tmp_path, recorded.assign(**{c: recorded[c] / 24.0 for c in sent}))])
    units = {g.what: g.value for g in found.guesses if g.what.startswith("unit of command")}
    assert units == {f"unit of {c}": "1" for c in sent}


def test_a_log_without_the_gear_is_a_fault(tmp_path: Path, recorded: pd.DataFrame) -> None:
    found = draft(geared(tmp_path, -1.0), [write(tmp_path, recorded)])
    assert {m.column for m in found.mends} & {"command.elbow", "position.elbow"}
