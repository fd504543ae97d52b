"""What an effect with memory starts from before a window: where a position servo is, and not where it is told to be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import robot_of, wheel_xml

from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.settings import Knob, assemble
from residual_mpc.models.targets import Targets

STIFF, DAMPED, RATE = 40.0, 2.0, 0.25  # N m/rad, N m s/rad, rad/s
FINE, PERIOD = 2e-4, 0.01  # s


def limited_run(seconds: float = 24.0) -> Run:
    """A servo behind a setpoint that follows the command at RATE, which takes seconds to cross a jump; explicit Euler
    steps of 0.2 ms of an inertia of 0.02 kg m^2."""
    every, n = round(PERIOD / FINE), round(seconds / PERIOD)
    t = PERIOD * np.arange(n)
    sent = np.where(np.sin(2.0 * np.pi * t / 11.0) > 0.0, 1.0, -0.6)
    q, w, setpoint, seen = 0.0, 0.0, 0.0, np.empty(n)
    for k in range(n):
        seen[k] = q
        for _ in range(every):
            setpoint += float(np.clip(sent[k] - setpoint, -RATE * FINE, RATE * FINE))
            w += FINE * (STIFF * (setpoint - q) - DAMPED * w) / 0.02
            q += FINE * w
    noise = 1e-4 * np.random.default_rng(0).standard_normal(n)
    return Run("run", t, {"command.hub": sent, "position.hub": seen + noise})


def test_a_limited_rate_goes_on_from_the_setpoint_that_it_let_through(tmp_path: Path) -> None:
    """Jumps that take longer than the warm-up lasts: from the command at its beginning the setpoint would be there."""
    robot = robot_of(tmp_path, wheel_xml(f'<position name="hub" joint="hub" kp="{STIFF}" kv="{DAMPED}"/>'))
    moving = {"position.hub": np.array([0.1, 0.2]), "velocity.hub": np.array([0.0, 1.0])}
    assert optional.steady_setpoints(robot, moving) == pytest.approx(np.array([[0.1], [0.2 + DAMPED / STIFF]]))
    data = build_dataset([limited_run()], [robot], {"position.hub": 1e-4})
    limit = {Knob("rate_limit", "hub", "rate"): RATE}
    error = data.y - predict(data, assemble([limit], Targets(robot)))[0]
    assert gap_of(data, measure_scales(data), error).total < 0.03


@pytest.mark.parametrize(
    "actuator",
    [
        '<motor name="hub" joint="hub"/>',
        '<general name="hub" joint="hub" gainprm="20" biastype="affine" biasprm="0 -10 -1"/>',
        '<general name="hub" joint="hub" gainprm="20" biastype="affine" biasprm="5 -20 -1"/>',
        '<intvelocity name="hub" joint="hub" kp="20" actrange="-3 3"/>',
    ],
)
def test_what_is_no_plain_position_servo_has_no_setpoint_to_trail(actuator: str, tmp_path: Path) -> None:
    robot = robot_of(tmp_path, wheel_xml(actuator))
    assert np.isnan(optional.steady_setpoints(robot, {"position.hub": np.zeros(1)})).all()
