"""A position servo's gain alone: its stiffness is scaled, its damping and its limit stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import arm_xml, random_drive, random_start, robot_of

from residual_mpc.models.settings import Settings

ROWS, STEPS = 3, 200
SERVOS = ('<position name="j1" joint="j1" kp="{0}" kv="1.5" forcerange="-3 3"/>'
          '<position name="j2" joint="j2" kp="15" kv="0"/>')  # fmt: skip


def test_it_is_another_gain_in_the_model(tmp_path: Path) -> None:
    """Also at the servo's limit."""
    (tmp_path / "nominal").mkdir()
    (tmp_path / "stiffer").mkdir()
    nominal = robot_of(tmp_path / "nominal", arm_xml(SERVOS.format(40.0)))
    stiffer = robot_of(tmp_path / "stiffer", arm_xml(SERVOS.format(56.0)))
    drive, start = random_drive(nominal, ROWS, STEPS), random_start(nominal, ROWS)
    wanted = (*nominal.channels, "output.j1")
    changed = Settings(ROWS, {"position_gain": {"gain": np.full((ROWS, 1), 1.4)}})
    found = nominal.replay(start, drive, changed, wanted)
    expected = stiffer.replay(start, drive, Settings(ROWS), wanted)
    plain = nominal.replay(start, drive, Settings(ROWS), wanted)
    for channel in wanted:
        np.testing.assert_allclose(found[channel], expected[channel], atol=1e-9)
    assert np.abs(expected["position.j1"] - plain["position.j1"]).max() > 1e-3
    assert np.abs(expected["output.j1"]).max() == pytest.approx(3.0)


def test_a_servo_without_damping_has_no_place_for_it(tmp_path: Path) -> None:
    """Its whole gain is a position gain."""
    robot = robot_of(tmp_path, arm_xml(SERVOS.format(40.0)))
    assert robot.slots("position_gain") == ("j1",)
