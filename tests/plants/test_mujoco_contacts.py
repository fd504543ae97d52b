"""Shapes that overlap where the robot was measured do not collide."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from oracles.arms import CHANNELS, random_drive, random_start, robot_of

import residual_mpc as rm
from residual_mpc.models.settings import Settings

ARM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    {world}
    <body name="foot" pos="0 0 0.5">
      <joint name="j1" axis="0 0 1" damping="0.1" armature="0.02"/>
      <geom type="box" size="0.1 0.1 {high}" mass="0.5" {shape}/>
      <body name="upper" pos="0 0 0.1">
        <joint name="j2" axis="0 1 0" damping="0.1" armature="0.02"/>
        <geom type="capsule" fromto="0 0 0.1 0 0 0.3" size="0.02" mass="0.3" {shape}/>
        <body {name} pos="0 0 0.3">
          <joint name="j3" axis="0 1 0" damping="0.1" armature="0.02"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.36" size="0.02" mass="0.2" {shape}/>
          <site name="tool" pos="0 0 0.3"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="j1" joint="j1" kp="40" kv="2"/><position name="j2" joint="j2" kp="40" kv="2"/>
    <position name="j3" joint="j3" kp="20" kv="1"/>
  </actuator>
</mujoco>"""
FREE = 'contype="0" conaffinity="0"'
THREE = (*CHANNELS, "position.j3", "velocity.j3")


def arm(shape: str = "", world: str = "", name: str = 'name="lower"', high: float = 0.05) -> str:
    return ARM.format(shape=shape, world=world, name=name, high=high)


def test_overlaps_are_as_deep_as_the_shapes(tmp_path: Path) -> None:
    """The lower link, folded back by 180 degrees, reaches into the foot; stretched out it touches nothing."""
    robot = robot_of(tmp_path, arm())
    folded = {"j1": np.zeros(2), "j2": np.zeros(2), "j3": np.array([0.0, np.pi])}
    found = robot.overlaps(folded)
    assert set(found) == {("foot", "lower")}  # a link and its child never collide
    assert found["foot", "lower"] == pytest.approx([0.0, 0.02 + 0.05 - (0.4 - 0.36)])
    assert robot_of(tmp_path, arm(FREE)).overlaps(folded) == {}
    assert robot.overlaps({}) == {}


@pytest.mark.parametrize("name", ['name="lower"', ""])
def test_without_contacts_bodies_pass_through_each_other(tmp_path: Path, name: str) -> None:
    """As those of a model without any; another pair still collides."""
    solid, free = robot_of(tmp_path, arm(name=name)), robot_of(tmp_path, arm(FREE, name=name))
    drive, start = random_drive(solid, 2, 300, size=0.3), dict(random_start(solid, 2))
    start |= {"position.j1": np.zeros(2), "position.j2": np.zeros(2), "position.j3": np.full(2, 2.6)}
    drive.command[:, :, 2] = 3.1
    made = solid.without_contacts([("foot", solid.links[2])])
    came, wanted, before = (r.replay(start, drive, Settings(2), THREE) for r in (made, free, solid))
    np.testing.assert_allclose(came["position.j3"], wanted["position.j3"], rtol=0, atol=1e-9)
    assert np.abs(before["position.j3"] - wanted["position.j3"]).max() > 0.05


def test_what_does_not_move_is_the_world(tmp_path: Path) -> None:
    wall = (
        '<geom type="plane" size="2 2 0.1"/><body name="table" pos="0 0 1.2"><geom type="box" size="1 1 0.2"/></body>'
    )
    robot = robot_of(tmp_path, arm(world=wall))
    found = robot.overlaps({"j1": np.zeros(1), "j2": np.zeros(1), "j3": np.zeros(1)})
    (pair,) = found
    assert "" in pair and "lower" in pair and found[pair][0] > 0.05
    assert not robot.without_contacts([pair]).overlaps({"j1": np.zeros(1), "j2": np.zeros(1), "j3": np.zeros(1)})


def test_an_object_is_not_where_the_model_has_it(tmp_path: Path) -> None:
    """A box that the arm may push lies in its way in the model."""
    box = '<body name="box" pos="0 0 0.9"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="0.1"/></body>'
    robot = robot_of(tmp_path, arm(world=box))
    assert robot.overlaps({"j1": np.zeros(1), "j2": np.zeros(1), "j3": np.zeros(1)}) == {}


def test_runs_in_poses_that_the_shapes_forbid_have_no_gap(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(arm())
    (tmp_path / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    model = mujoco.MjModel.from_xml_string(arm(FREE))
    data, t, rng = mujoco.MjData(model), 0.02 * np.arange(400), np.random.default_rng(0)
    command = np.stack([0.5 * np.sin(1.1 * t), 0.2 * np.sin(1.7 * t), 2.2 + 0.9 * np.sin(1.3 * t)], axis=1)
    data.qpos[:], q = command[0], []
    for u in command:
        q.append(data.qpos.copy())
        data.ctrl[:] = u
        mujoco.mj_step(model, data, 10)
    noisy = np.array(q) + 1e-3 * rng.standard_normal((len(t), 3))
    table = {"t": t} | {f"command.j{k + 1}": command[:, k] for k in range(3)}
    pd.DataFrame(table | {f"position.j{k + 1}": noisy[:, k] for k in range(3)}).to_csv(
        tmp_path / "run.csv", index=False
    )
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, tmp_path / "run.csv")
    (warning,) = [f for f in runs.findings if f.severity == "warning"]
    assert warning.kind == "overlapping shapes" and "foot and lower" in warning.message
    assert warning in rm.check(robot, runs).findings
    assert "overlapping shapes" in [f.kind for f in rm.check(robot, tmp_path / "run.csv").findings]
    gap = rm.measure_gap(robot, runs)
    assert gap.nominal < 2.0 * gap.noise_floor
