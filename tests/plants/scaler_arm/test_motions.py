"""The paper's motions: the shapes that they are called after, within the limits, and drawn by the arm."""

from __future__ import annotations

import numpy as np
import pytest
from postures import HIGH, LOW

from plants.scaler_arm.kinematics.forward import forward_kinematics
from plants.scaler_arm.kinematics.geometry import HOME, SCALER
from plants.scaler_arm.motions import CircleWithHeight, CircleWithLine, Motion, references, tool_path
from residual_mpc.errors import BadInput

MOTIONS: list[Motion] = [CircleWithLine(), CircleWithHeight(), CircleWithLine(0.05, 5.0, 3.0), CircleWithHeight(0.03)]
T = np.arange(0.0, 32.0, 0.01)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_motors_draw_it_with_the_gripper_held(motion: Motion) -> None:
    q = references(motion, T)
    tool, frame = forward_kinematics(q)
    np.testing.assert_allclose(tool, tool_path(motion, T), rtol=0, atol=1e-9)
    np.testing.assert_allclose(frame, np.broadcast_to(forward_kinematics(np.array(HOME))[1], frame.shape), atol=1e-9)
    assert ((q > LOW) & (q < HIGH)).all()
    assert np.abs(np.diff(q, axis=0)).max() / 0.01 < SCALER.speed
    assert np.ptp(q, axis=0).min() > 0.03  # every motor takes part: none is left out of what is learned


def test_a_circle_with_a_line_through_it() -> None:
    motion = CircleWithLine(radius=0.04, period=8.0, line=8.0)
    path = motion.offset(T)
    assert np.all(path[:, 2] == 0.0)
    at = np.mod(T, 16.0)
    np.testing.assert_allclose(np.hypot(*path[at < 8.0, :2].T), 0.04, atol=1e-12)
    line = path[at >= 8.0]
    assert np.all(line[:, 1] == 0.0)
    assert line[:, 0].min() == pytest.approx(-0.04) and line[:, 0].max() == pytest.approx(0.04, abs=1e-6)
    speed = np.diff(path, axis=0) / 0.01
    assert np.abs(np.diff(speed, axis=0)).max() < 1e-3  # m/s between samples: no jump of the speed anywhere


def test_a_circle_that_goes_up_and_down() -> None:
    path = CircleWithHeight(radius=0.04, period=8.0, height=0.02, waves=2).offset(T)
    np.testing.assert_allclose(np.hypot(path[:, 0], path[:, 1]), 0.04, atol=1e-12)
    assert path[:, 2].max() == pytest.approx(0.02) and path[:, 2].min() == pytest.approx(-0.02)
    turn = path[T < 8.0, 2]
    assert np.count_nonzero((turn[:-1] < 0) & (turn[1:] >= 0)) in (1, 2)  # up twice a turn, once where it begins


def test_a_motion_that_is_none_is_refused() -> None:
    with pytest.raises(BadInput, match="positive"):
        CircleWithLine(radius=0.0)
    with pytest.raises(BadInput, match="Unreachable|reach|allowed"):
        references(CircleWithHeight(radius=0.2), T)
