"""A velocity is out of step with its position's rate only where a shift explains what noise and sampling do not."""

from __future__ import annotations

import numpy as np
import pytest

from residual_mpc.logs.audit import ActuatorFacts, RobotFacts
from residual_mpc.logs.audit.rates import check_rates
from residual_mpc.logs.run import FloatArray, Run

JOINT = RobotFacts((ActuatorFacts("a", "a", "position"),), ("position.a", "velocity.a"))
GRAIN = {"fine": (1e-4, 1e-3), "usual": (1e-3, 1e-2), "coarse": (3e-3, 5e-2)}  # rad, rad/s: noise


def joint_run(
    rate: float, speed: float, grain: str, lag: float = 0.0, jitter: float = 0.0, hold: int = 1, seed: int = 0
) -> Run:
    """20 s of a joint that swings at about `speed` rad/s, its velocity `lag` s late.

    jitter: s by which samples are taken before or after their even stamps. hold: samples for which a sensor repeats
    itself.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(20.0 * rate)) / rate
    taken = t + jitter * rng.uniform(-1.0, 1.0, len(t))
    rates, phases = speed * np.array([0.5, 1.0, 1.7, 2.6]), rng.uniform(0.0, 6.28, 4)
    sizes = 1.0 / np.arange(1, 5)
    position = np.sin(np.outer(taken, rates) + phases) @ sizes
    velocity = np.cos(np.outer(taken - lag, rates) + phases) @ (sizes * rates)
    columns: dict[str, FloatArray] = {"command.a": position}
    for name, values, noise in zip(("position.a", "velocity.a"), (position, velocity), GRAIN[grain], strict=True):
        seen = values + noise * rng.standard_normal(len(t))
        columns[name] = np.repeat(seen[::hold], hold)[: len(t)]
    return Run("run", t, columns)


def steps(*runs: Run) -> list[str]:
    return [f.message for f in check_rates(runs, JOINT) if f.kind == "channels out of step"]


@pytest.mark.parametrize("rate", [50.0, 250.0, 500.0])
@pytest.mark.parametrize("speed", [0.5, 2.0, 6.0])
@pytest.mark.parametrize("grain", GRAIN)
@pytest.mark.parametrize("seed", range(3))
def test_a_sensor_in_step_is_not_accused(rate: float, speed: float, grain: str, seed: int) -> None:
    assert steps(joint_run(rate, speed, grain, seed=seed)) == []
    assert steps(joint_run(rate, speed, grain, seed=seed, jitter=0.003)) == []
    assert steps(joint_run(rate, speed, grain, seed=seed, hold=5)) == []


def test_runs_of_different_rates_are_not_accused() -> None:
    slow = joint_run(50.0, 2.0, "usual", seed=1)
    assert steps(*(joint_run(500.0, 2.0, "usual", seed=k) for k in range(3)), slow) == []


@pytest.mark.parametrize(("rate", "speed", "lag"), [(500.0, 6.0, 0.006), (500.0, 2.0, 0.03), (50.0, 2.0, 0.08)])
def test_a_late_velocity_is_found(rate: float, speed: float, lag: float) -> None:
    (message,) = steps(joint_run(rate, speed, "usual", lag))
    assert float(message.split(" is ")[1].split(" ms")[0]) == pytest.approx(1e3 * lag, rel=0.25)
    assert "behind" in message
