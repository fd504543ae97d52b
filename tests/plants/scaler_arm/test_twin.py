"""The twin: without withheld effects it is its engine, each effect does what it is called, and the truth names it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from plants.scaler_arm.dynamics.stick_slip import Sticking, sticking_start, sticking_step
from plants.scaler_arm.engines.mujoco_arm import MujocoArm
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS, SCALER
from plants.scaler_arm.kinematics.loop_closure import at_posture
from plants.scaler_arm.motions import CircleWithHeight, references
from plants.scaler_arm.twin import ENCODERS, Twin, twin
from plants.scaler_arm.withheld import TYPICAL, Withheld, really, truth
from plants.simulator import Recording, Simulator, record, replaying
from residual_mpc.errors import BadInput

Q = references(CircleWithHeight(), np.arange(0.0, 4.0, 0.01))


def run(simulator: Simulator, seed: int = 0) -> np.ndarray:
    """(n, 6) rad: motor positions while the arm draws."""
    table = record(simulator, replaying(Q, 0.01), Recording(3.9, 0.01, at_posture(Q[0])), np.random.default_rng(seed))
    return np.asarray(table[[f"position.{m}" for m in MOTORS]].to_numpy())


def test_a_twin_that_withholds_nothing_is_its_engine() -> None:
    np.testing.assert_array_equal(run(Twin(MujocoArm(), Withheld())), run(MujocoArm()))


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_the_same_seed_gives_the_same_run(engine: str) -> None:
    first, again, other = run(twin(engine), 1), run(twin(engine), 1), run(twin(engine), 2)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-4


def test_a_delay_shifts_the_run() -> None:
    plain, late = run(MujocoArm()), run(Twin(MujocoArm(), Withheld(delay=0.03)))
    np.testing.assert_allclose(late[100:], plain[97:-3], atol=1e-4)  # once the start has died out


def test_a_payload_makes_the_arm_sag_and_a_weak_servo_more_so() -> None:
    def sag(withheld: Withheld) -> float:
        simulator = MujocoArm(really(SCALER, withheld))
        still = np.repeat(np.array(HOME)[None], 300, axis=0)
        how = Recording(2.9, 0.01, at_posture(still[0]))
        table = record(simulator, replaying(still, 0.01), how, np.random.default_rng(0))
        return float(table["tool.z"].iloc[0] - table["tool.z"].iloc[-1])

    bare, loaded, weak = sag(Withheld()), sag(Withheld(payload=0.2)), sag(Withheld(gain=0.5))
    assert 0 < bare < loaded
    assert weak == pytest.approx(2 * bare, rel=0.1)


def test_what_sticks_slips() -> None:
    """A slow ramp: the joint moves in jumps of stick - slip, each after stick of error; a fast one follows behind."""
    law = Sticking(stick=0.006, slip=0.002, slowest=0.02)
    seen = {}
    for speed in (0.005, 0.5):
        x, out = sticking_start(np.zeros(1)), []
        for k in range(4000):
            y, x = sticking_step(law, x, np.array([speed * 0.002 * (k + 1)]), 0.002)
            out.append(float(y[0]))
        seen[speed] = np.array(out)
    jumps = np.diff(seen[0.005])
    jumps = jumps[jumps != 0]
    np.testing.assert_allclose(jumps[0], 0.004, atol=2e-5)
    assert 4 <= len(jumps) <= 12
    fast = 0.5 * 0.002 * np.arange(1, 4001) - seen[0.5]
    np.testing.assert_allclose(fast[20:], 0.002, atol=1e-12)


def test_sticking_at_zero_does_nothing() -> None:
    x = sticking_start(np.zeros(2))
    for command in np.random.default_rng(0).standard_normal((50, 2)):
        y, x = sticking_step(Sticking(), x, command, 0.002)
        np.testing.assert_array_equal(y, command)


def test_encoders_count() -> None:
    counts = run(Twin(MujocoArm(), Withheld(counts=4096))) / (2 * np.pi / 4096)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)


def test_the_truth_names_what_is_withheld() -> None:
    record_ = truth(TYPICAL, "mujoco")
    json.dumps(record_)
    named = [e["effect"] for e in record_["effects"]]
    assert named == ["command_delay", "payload", "actuator_gain", "viscous_friction"]
    assert any("stick" in cause for cause in record_["beyond"])
    assert truth(Withheld(), "mujoco")["effects"] == []


def test_the_camera_is_slow_and_jumps_while_the_encoders_do_not() -> None:
    table = record(
        twin("pybullet"), replaying(Q, 0.01), Recording(3.9, 0.01, at_posture(Q[0])), np.random.default_rng(3)
    )
    assert 0.2 < table["tool.x"].notna().mean() < 0.45
    assert table["position.a"].notna().all()
    assert set(ENCODERS.sigma) < set(table)


def test_an_engine_that_is_none_is_refused() -> None:
    with pytest.raises(BadInput, match="one of mujoco, pybullet"):
        twin("webots")
