"""Effects that change a model's structure are found, with their value, in logs that no model of this house made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from oracles.two_masses import Gear

from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.logs.run import Run

SIGMA, DT, SECONDS = 1e-3, 0.02, 10.0  # rad, s, s
T = DT * np.arange(int(SECONDS / DT) + 1)
SPRING = Gear(60.0, 0.03)
PLAY = Gear(4000.0, 4.0, play=0.05)


def sines(rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """(K,) rad: three slow sines."""
    return sum(rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * f * T + rng.uniform(0, 6)) for f in (0.4, 0.9, 1.7)) * size


def swing(gear: Gear, seed: int) -> Run:
    rng = np.random.default_rng(seed)
    u = sines(rng)
    states = gear.driven(gear.at_rest(u[0]), u[:-1], DT)
    return Run(
        f"run{seed}",
        T,
        {"command.shoulder": u, "position.shoulder": gear.logged(states) + SIGMA * rng.standard_normal(len(T))},
    )


@pytest.mark.parametrize(
    ("gear", "effect", "truth", "only"),
    [
        (SPRING, "joint_compliance", 60.0, ("joint_compliance", "viscous_friction")),
        (PLAY, "backlash", 0.05, ("backlash", "viscous_friction")),
        pytest.param(SPRING, "joint_compliance", 60.0, (), marks=pytest.mark.slow),
        pytest.param(PLAY, "backlash", 0.05, (), marks=pytest.mark.slow),
        pytest.param(replace(PLAY, sensor="motor"), "backlash", 0.05, (), marks=pytest.mark.slow),
    ],
)
def test_what_lies_between_motor_and_link(
    tmp_path: Path, gear: Gear, effect: str, truth: float, only: tuple[str, ...]
) -> None:
    robot = robot_of(tmp_path, gear.xml % (0.001, "implicitfast"), position_sensor=gear.sensor)
    runs, noise = [swing(gear, 1)], {"position.shoulder": SIGMA}
    made = diagnose(runs, [robot], noise, (), Options(only=only), np.random.default_rng(0))
    (cause,) = made.diagnosis.causes
    estimate = cause.parameters[0]
    assert cause.term.effect == effect
    assert estimate.value == pytest.approx(truth, rel=0.05)


def test_a_longer_link(tmp_path: Path) -> None:
    """The truth: the model compiled with the elbow farther out, stepped by RK4 four times as finely."""
    rng, robot = np.random.default_rng(0), robot_of(tmp_path, arm_xml())
    spec = mujoco.MjSpec.from_string(arm_xml(integrator="RK4"))
    spec.option.timestep = 0.0005
    line = np.array([0.3, 0.0, 0.05])
    spec.body("lower").pos = spec.body("lower").pos + 0.033 * line / np.linalg.norm(line)
    model = spec.compile()
    data, u, q = mujoco.MjData(model), np.stack([sines(rng, 2.0), sines(rng, 2.0)], axis=1), []
    for command in u:
        q.append(data.qpos.copy())
        data.ctrl[:] = command
        mujoco.mj_step(model, data, round(DT / 0.0005))
    names = ("j1", "j2")
    columns = {f"command.{j}": u[:, i] for i, j in enumerate(names)}
    seen = np.array(q) + SIGMA * rng.standard_normal((len(T), 2))
    run = Run("run", T, columns | {f"position.{j}": seen[:, i] for i, j in enumerate(names)})
    noise = {f"position.{j}": SIGMA for j in names}
    only = Options(only=("link_length", "payload"))
    made = diagnose([run], [robot], noise, (), only, np.random.default_rng(0))
    (cause,) = made.diagnosis.causes
    estimate = cause.parameters[0]
    assert (cause.term.effect, estimate.name) == ("link_length", "offset")
    low, high = estimate.ci95
    assert low < 0.033 < high
    assert estimate.value == pytest.approx(0.033, rel=0.15)  # ten seconds: the interval is 40 % to either side
