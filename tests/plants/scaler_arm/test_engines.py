"""Both engines hold the same arm: kinematics, energy, the loop, and what they record."""

from __future__ import annotations

import subprocess
import sys
import time

import mujoco
import numpy as np
import pytest
from postures import anywhere

from plants.scaler_arm.engines.mjcf import Options, mjcf
from plants.scaler_arm.engines.mujoco_arm import MujocoArm
from plants.scaler_arm.engines.pybullet_arm import PybulletArm
from plants.scaler_arm.engines.pybullet_world import World
from plants.scaler_arm.kinematics.forward import forward_kinematics, passive_angles
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS, PASSIVE, SCALER
from plants.scaler_arm.kinematics.inverse import inverse_kinematics
from plants.scaler_arm.kinematics.loop_closure import at_posture, joints_at
from plants.simulator import Recording, Simulator, record, replaying, running
from residual_mpc.errors import BadInput

ENGINES: dict[str, Simulator] = {"mujoco": MujocoArm(), "pybullet": PybulletArm()}
NO_MOTORS = Options(timestep=0.0005, friction=False, motors=False)
WITHIN = 1e-6  # m, asked for; MuJoCo agrees to rounding, PyBullet computes its frames in single precision


def circle(seconds: float, period: float = 0.01) -> np.ndarray:
    """(n, 6) rad: two turns of 40 mm radius about the home pose's tool, the gripper's frame kept."""
    tool, frame = forward_kinematics(np.array(HOME))
    t = np.arange(0.0, seconds + 0.5 * period, period)
    w = 2 * np.pi * 2 / seconds
    path = tool + 0.04 * np.stack([np.cos(w * t) - 1.0, np.sin(w * t), 0.5 * np.sin(2 * w * t)], axis=-1)
    return inverse_kinematics(path, np.broadcast_to(frame, (len(t), 3, 3)))


def test_mujoco_finds_the_tool_where_the_kinematics_do() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf())
    data = mujoco.MjData(model)
    at = [int(model.joint(n).qposadr[0]) for n in MOTORS + PASSIVE]
    q = anywhere(300)
    tool, frame = forward_kinematics(q)
    for row, passive in enumerate(passive_angles(q)):
        data.qpos[at] = np.concatenate([q[row], passive])
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.site("tool").xpos, tool[row], rtol=0, atol=1e-13)
        np.testing.assert_allclose(data.body("gripper").xmat.reshape(3, 3), frame[row], rtol=0, atol=1e-13)
        assert np.abs(data.site("loop_b").xpos - data.site("loop_e").xpos).max() < 1e-14


def test_pybullet_finds_the_tool_where_the_kinematics_do() -> None:
    world = World(SCALER)
    q = anywhere(300)
    tool, _ = forward_kinematics(q)
    for row in range(len(q)):
        world.put(joints_at(at_posture(q[row]), SCALER))
        np.testing.assert_allclose(world.point("tool"), tool[row], rtol=0, atol=WITHIN)
        np.testing.assert_allclose(world.point("loop_b"), world.point("loop_e"), rtol=0, atol=WITHIN)
    world.close()


def test_without_friction_energy_is_kept_and_the_loop_holds() -> None:
    """MuJoCo, falling freely until the first stop; fourth order in time, so that only the loop's softness is left."""
    model = mujoco.MjModel.from_xml_string(mjcf(SCALER, NO_MOTORS).replace("implicitfast", "RK4"))
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    q = np.array(HOME)
    data.qpos[[int(model.joint(n).qposadr[0]) for n in MOTORS + PASSIVE]] = np.append(q, passive_angles(q))
    mujoco.mj_forward(model, data)
    before = data.energy.sum()
    for _ in range(int(0.1 / NO_MOTORS.timestep)):
        mujoco.mj_step(model, data)
        assert np.abs(data.site("loop_b").xpos - data.site("loop_e").xpos).max() < 1e-6
    mujoco.mj_forward(model, data)
    assert data.energy[1] > 0.05  # J, kinetic: it does move
    assert abs(data.energy.sum() - before) < 1e-6


def test_both_engines_fall_alike_as_the_step_shrinks() -> None:
    """No friction, no motors, no rotor inertia (PyBullet knows none): the difference is PyBullet's first-order step."""
    from dataclasses import replace

    bare = replace(SCALER, servo=replace(SCALER.servo, armature=0.0))
    rng, still = np.random.default_rng(0), np.zeros(6)

    def fallen(simulator: Simulator, steps: int) -> np.ndarray:
        with running(simulator, rng, at_posture(np.array(HOME))) as plant:
            for _ in range(steps):
                plant.step(still, 0.08 / steps)
            reading = plant.truth()
        return np.array([reading[f"position.{m}"] for m in MOTORS])

    exact = fallen(MujocoArm(bare, Options(friction=False, motors=False)), 1600)
    off = [np.abs(fallen(PybulletArm(bare, friction=False, motors=False), n) - exact).max() for n in (40, 80, 160)]
    assert np.abs(exact - HOME).max() > 0.1
    assert 1.8 < off[0] / off[1] < 2.2 and 1.8 < off[1] / off[2] < 2.2


@pytest.mark.parametrize("engine", ENGINES)
def test_the_same_seed_gives_the_same_run_in_seconds(engine: str) -> None:
    q = circle(60.0)
    how = Recording(60.0, 0.01, at_posture(q[0]))
    began = time.process_time()
    first = record(ENGINES[engine], replaying(q, 0.01), how, np.random.default_rng(1))
    assert time.process_time() - began < 15.0  # a minute of the robot; about 1 s on one free core
    again = record(ENGINES[engine], replaying(q[:301], 0.01), Recording(3.0, 0.01, how.at), np.random.default_rng(1))
    assert len(first) == 6001 and list(first)[:2] == ["t", "command.shoulder"]
    assert again.equals(first.iloc[:301])


@pytest.mark.parametrize("engine", ENGINES)
def test_it_follows_its_commands_and_its_loop_stays_closed(engine: str) -> None:
    q = circle(10.0)
    run = record(ENGINES[engine], replaying(q, 0.01), Recording(10.0, 0.01, at_posture(q[0])), np.random.default_rng(0))
    came = run[[f"position.{m}" for m in MOTORS]].to_numpy()
    lag = SCALER.servo.damping / SCALER.servo.stiffness
    late = round(lag / 0.01)
    np.testing.assert_allclose(came[2 * late :], q[late:-late], atol=0.03)  # the servo's lag, then gravity's sag
    tool = run[["tool.x", "tool.y", "tool.z"]].to_numpy()
    np.testing.assert_allclose(tool, forward_kinematics(came)[0], atol=3e-4)  # an open loop would move the tool


def test_the_gap_between_the_engines_is_small_and_is_gravity() -> None:
    """A spring sags under the arm's weight, PyBullet's motor does not; in the plane of the shoulder nothing sags."""
    q = circle(10.0)
    how = Recording(10.0, 0.01, at_posture(q[0]))
    runs = {
        e: record(s, replaying(q, 0.01), how, np.random.default_rng(0))
        for e, s in (("mujoco", MujocoArm()), ("pybullet", PybulletArm(timestep=0.002)))
    }
    off = {m: runs["mujoco"][f"position.{m}"] - runs["pybullet"][f"position.{m}"] for m in MOTORS}
    rms = {m: float(np.sqrt((x[100:] ** 2).mean())) for m, x in off.items()}
    assert max(rms.values()) < 0.012
    assert rms["shoulder"] < 0.1 * rms["f"]


def test_any_rate_will_do() -> None:
    for simulator in ENGINES.values():
        with running(simulator, np.random.default_rng(0), at_posture(np.array(HOME))) as plant:
            for dt in (0.003, 0.01, 0.017, 0.03):
                plant.step(np.array(HOME), dt)
            assert plant.time == pytest.approx(0.06)
            assert abs(plant.measure()["position.shoulder"]) < 1e-3


def test_a_start_that_cannot_be_is_refused() -> None:
    for simulator in ENGINES.values():
        with pytest.raises(BadInput, match="unknown channels in the start: position.b"):
            simulator.start(np.random.default_rng(0), {"position.b": 0.1})
        with pytest.raises(BadInput, match="position.a must start between"):
            simulator.start(np.random.default_rng(0), {"position.a": 2.0})


def test_engines_are_imported_when_they_are_started(monkeypatch: pytest.MonkeyPatch) -> None:
    program = (
        "import sys, plants.scaler_arm.record, plants.scaler_arm.robot, plants.scaler_arm.pybullet_robot\n"
        "assert not {'mujoco', 'pybullet', 'casadi', 'jax', 'pandas', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(BadInput, match="residual-mpc\\[pybullet\\]"):
        PybulletArm().start(np.random.default_rng(0), {})
