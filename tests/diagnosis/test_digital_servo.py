"""A servo that holds its torque for a period hides rotor inertia: the interval reaches as far."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import residual_mpc as rm
from residual_mpc.diagnosis.results.digital_servo import PERIOD, hidden_inertia
from residual_mpc.models.settings import Knob

ARM = """
<mujoco><option timestep="0.002"/><worldbody><body name="a"><joint name="j" type="hinge" axis="0 1 0"/>
<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/><body name="b" pos="0 0 -0.3">
<joint name="k" type="hinge" axis="0 1 0"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.5"/></body>
</body></worldbody>
<actuator><position name="s" joint="j" kp="60" kv="4"/><motor name="m" joint="k"/></actuator></mujoco>
"""


def test_of_position_servos_alone(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ARM)
    robot = rm.load_robot(tmp_path / "arm.xml").model
    for joint, more in (("j", 0.5 * PERIOD * 4.0), ("k", 0.0), (None, 0.5 * PERIOD * 4.0)):
        assert hidden_inertia(robot, Knob("armature", joint, "inertia")) == pytest.approx(more)
    assert hidden_inertia(robot, Knob("coulomb_friction", "j", "torque")) == 0.0


def test_a_held_torque_is_what_less_inertia_would_be() -> None:
    """One joint on a servo, against the exact motion between two computations of its torque."""
    inertia, kp, kd, period, end = 0.05, 60.0, 4.0, 0.001, 0.4

    def held() -> np.ndarray:
        q, v, out = 0.0, 0.0, [0.0]
        for _ in range(round(end / period)):
            a = (kp * (1.0 - q) - kd * v) / inertia
            q, v = q + v * period + 0.5 * a * period**2, v + a * period
            out.append(q)
        return np.array(out)

    def continuous(less: float, friction: float) -> np.ndarray:
        a = np.array([[0.0, 1.0], [-kp / (inertia - less), -(kd - friction) / (inertia - less)]])
        value, vector = np.linalg.eig(a)
        t = period * np.arange(round(end / period) + 1)
        start = np.linalg.solve(vector, np.array([-1.0, 0.0]))
        return np.asarray(1.0 + (vector[0] * start * np.exp(np.outer(t, value))).sum(axis=1).real)

    friction = 0.5 * period * kp
    off = [np.abs(held() - continuous(less, friction)).max() for less in (0.0, 0.5 * period * kd)]
    assert off[1] < 0.1 * off[0]
