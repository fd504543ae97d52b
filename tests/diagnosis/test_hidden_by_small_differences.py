"""An effect that small differences elsewhere could stand for, where the sensors are far better than the gap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import robot_of

from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Term

LAG, MORE = 0.05, 150.0  # s, N s/m more damping of the second axis
MASS, STIFF, DAMPED, FRICTION = (18.0, 9.0), (20000.0, 12000.0), (1500.0, 800.0), (60.0, 40.0)
FINE, PERIOD, SECONDS, SIGMA = 1e-4, 0.01, 16.0, 1e-5  # s, s, s, m
AXES = ("gx", "gy")
XML = """<mujoco model="table"><option timestep="0.001" integrator="implicitfast" gravity="0 0 0"/><worldbody>
<body name="x"><joint name="gx" type="slide" axis="1 0 0" damping="60" armature="6"/>
<inertial pos="0 0 0" mass="7" diaginertia="1 1 1"/>
<body name="y"><joint name="gy" type="slide" axis="0 1 0" damping="40" armature="4"/>
<inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/></body></body></worldbody>
<actuator><position name="gx" joint="gx" kp="20000" kv="1500"/><position name="gy" joint="gy" kp="12000" kv="800"/>
</actuator></mujoco>"""


def table_run(seed: int) -> Run:
    """Two axes that do not disturb each other, each behind a setpoint that trails its command; explicit Euler steps of
    0.1 ms. They rest for half a second."""
    rng, every, n = np.random.default_rng([seed, 5]), round(PERIOD / FINE), round(SECONDS / PERIOD)
    t = PERIOD * np.arange(n)
    moved = np.clip(t - 0.5, 0.0, None)
    columns = {}
    for axis, m, k, d, f, more in zip(AXES, MASS, STIFF, DAMPED, FRICTION, (0.0, MORE), strict=True):
        frequency, size = rng.uniform(0.2, 0.9, 3), rng.uniform(0.02, 0.08, 3)
        sent = (size * np.sin(2.0 * np.pi * frequency * moved[:, None]) * (moved / (1.0 + moved))[:, None]).sum(axis=1)
        x = v = setpoint = 0.0
        seen = np.empty(n)
        for i in range(n):
            seen[i] = x
            for _ in range(every):
                setpoint += FINE * (sent[i] - setpoint) / LAG
                v += FINE * (k * (setpoint - x) - (d + f + more) * v) / m
                x += FINE * v
        columns |= {f"command.{axis}": sent, f"position.{axis}": seen + SIGMA * rng.standard_normal(n)}
    return Run(f"r{seed}", t, columns)


@pytest.mark.slow
def test_more_damping_beside_a_lag_is_named(tmp_path: Path) -> None:
    """It delays one axis by 12 ms more, as a delay or another lag of that axis nearly would."""
    robot = robot_of(tmp_path, XML)
    found = diagnose([table_run(k) for k in range(3)], [robot] * 3, {}, (), Options(), np.random.default_rng(0))
    sizes = {c.term: c.parameters[0] for c in found.diagnosis.causes}
    damping = sizes[Term("viscous_friction", "gy")]
    assert damping.ci95[0] < MORE < damping.ci95[1]
    lags = [x for t, x in sizes.items() if t.effect in ("actuator_lag", "sensor_lag")]
    assert len(lags) == 1 and abs(lags[0].value - LAG) < 0.002
    assert len(sizes) == 2
