"""Small MuJoCo models for the tests, and the literal way to step them: mujoco.mj_step, one row at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from plants.mujoco_robot import MujocoRobot, build
from residual_mpc.effects.library import LIBRARY
from residual_mpc.models.protocol import Drive
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob, Settings, assemble

DT = 0.002  # s
CHANNELS = ("position.j1", "position.j2", "velocity.j1", "velocity.j2")  # of the arm
Hypothesis = dict[tuple[str, str | None, str], float]  # {(effect, target, parameter): value}
SERVOS = """
<position name="j1" joint="j1" kp="30" kv="1.5" gear="2"/>
<position name="j2" joint="j2" kp="20" kv="0.8" forcerange="-3 3"/>
"""
MIXED = """
<motor name="j1" joint="j1" gear="3"/>
<velocity name="j2" joint="j2" kv="0.9"/>
"""
FILTERED = """
<general name="j1" joint="j1" dyntype="filterexact" dynprm="0.05" gainprm="20" biastype="affine"
         biasprm="0 -20 -1"/>
<motor name="j2" joint="j2"/>
"""


def arm_xml(actuators: str = SERVOS, integrator: str = "implicitfast", gravity: float = -9.81) -> str:
    """Two hinges under gravity; the second has friction and a stop."""
    return f"""
<mujoco>
  <option timestep="{DT}" integrator="{integrator}" gravity="0 0 {gravity}"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="j1" axis="0 1 0" damping="0.1" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0.05" size="0.03" mass="0.8"/>
      <body name="lower" pos="0.3 0 0.05">
        <joint name="j2" axis="0 1 0.2" damping="0.05" armature="0.005" frictionloss="0.02" range="-90 90"/>
        <geom type="box" pos="0.1 0.01 0" size="0.1 0.02 0.03" euler="10 20 30" mass="0.4"/>
        <site name="middle" pos="0.1 0 0"/>
        <site name="tool" pos="0.2 0.01 -0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>"""


def wheel_xml(actuator: str = '<motor name="hub" joint="hub"/>', joint: str = "") -> str:
    """One hinge with an inertia of 0.02 kg m^2 about its own centre, and no other force."""
    return f"""
<mujoco>
  <option timestep="{DT}" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body name="rotor">
      <joint name="hub" axis="0 0 1" {joint}/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.012 0.012 0.02"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>"""


def robot_of(folder: Path, xml: str, **keys: Any) -> MujocoRobot:
    path = folder / "robot.xml"
    path.write_text(xml)
    return build(RobotFile("robot", "mujoco", model=path, **keys))


def settings_of(robot: MujocoRobot, *hypotheses: Hypothesis) -> Settings:
    """One row for each."""
    rows = [{Knob(*k): v for k, v in h.items()} for h in hypotheses]
    return assemble(rows, {e.name: robot.slots(e.name) for e in LIBRARY})


def random_drive(robot: MujocoRobot, rows: int, steps: int, seed: int = 0, size: float = 0.6) -> Drive:
    """Commands that jump every 40 ms, with a lead of 0.3 s."""
    rng, lead, hold = np.random.default_rng(seed), 150, 20
    count = -(-(lead + steps) // hold)
    u = np.repeat(rng.uniform(-size, size, (rows, count, len(robot.actuators))), hold, axis=1)
    return Drive(DT, lead, u[:, : lead + steps], None, np.zeros(rows))


def random_start(robot: MujocoRobot, rows: int, seed: int = 1) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    channels = [c for s in robot.states for c in (s.position, s.velocity) if c is not None]
    return {c: 0.3 * rng.standard_normal(rows) for c in channels}


def assert_rows_are_themselves(robot: MujocoRobot, hypotheses: Sequence[Hypothesis], steps: int) -> None:
    """Each hypothesis' row of one replay is, to the last bit, the replay of it alone."""
    rows = len(hypotheses)
    drive, start = random_drive(robot, rows, steps), random_start(robot, rows)
    whole = robot.replay(start, drive, settings_of(robot, *hypotheses), CHANNELS)
    for row, hypothesis in enumerate(hypotheses):
        at = slice(row, row + 1)
        mine = replace(drive, command=drive.command[at], clock=drive.clock[at])
        alone = robot.replay({k: x[at] for k, x in start.items()}, mine, settings_of(robot, hypothesis), CHANNELS)
        for channel in CHANNELS:
            assert np.isfinite(whole[channel]).all()
            np.testing.assert_array_equal(whole[channel][row], alone[channel][0])


def literal(
    model: mujoco.MjModel, start: dict[str, np.ndarray], controls: np.ndarray, row: int, act: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and speeds (K + 1, nq) and forces (K, nu) of one row under controls (K, nu)."""
    data = mujoco.MjData(model)
    for j in range(model.njnt):
        data.qpos[j] = start[f"position.{model.joint(j).name}"][row]
        data.qvel[j] = start[f"velocity.{model.joint(j).name}"][row]
    if model.na:
        data.act[:] = controls[0, model.actuator_actadr >= 0]
    q, v, force = [data.qpos.copy()], [data.qvel.copy()], []
    for u in controls:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        q.append(data.qpos.copy())
        v.append(data.qvel.copy())
        force.append(data.actuator_force.copy())
    return np.array(q), np.array(v), np.array(force)
