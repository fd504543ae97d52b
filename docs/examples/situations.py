"""Robots in the situations of the how-to pages: writes a robot file, its model and three logs into a folder.

    python docs/examples/situations.py payload FOLDER

Situations: payload, delay, gains, policy (an arm of three position servos), servo (one servo), drift (two wheels).
What is printed last is what the robot really has, and its model does not know.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd

NAMES = ("base", "shoulder", "elbow")
STEP, PERIOD, SECONDS = 0.0005, 0.01, 10.0  # s: of the simulated robot, of its log, of a run
NOISE = 3e-4  # rad, 1-sigma of an encoder
ARMS = {  # what the real arm has
    "payload": {"payload": 0.25},  # kg at the tool
    "delay": {"delay": 0.06},  # s
    "gains": {"gain": 0.6},  # of every servo's stiffness and damping
    "policy": {"delay": 0.04, "friction": 0.5},  # s; N m of dry friction in the elbow
}
SERVO = {"gain": 0.7, "friction": 0.05}
ROVER = {"right": 1.03, "track": 1.10, "wheel_radius": 0.05, "track_width": 0.30}  # ratio, ratio, m, m


def arm(gain=1.0, payload=0.0, friction=0.0, step=0.002):
    """MJCF of the arm: the model with the defaults."""
    load = f'<geom type="sphere" size="0.03" pos="0.25 0 0" mass="{payload}"/>' if payload else ""
    servos = "".join(
        f'<position name="{n}" joint="{n}" kp="{gain * kp}" kv="{gain * kv}" ctrlrange="-2 2"/>'
        for n, kp, kv in zip(NAMES, (60, 60, 25), (4, 4, 1.5), strict=True)
    )
    return f"""<mujoco model="desk_arm"><option timestep="{step}" integrator="implicitfast"/>
      <default><geom contype="0" conaffinity="0"/><joint armature="0.02" damping="0.2"/></default>
      <worldbody>
        <geom type="cylinder" size="0.08 0.05" pos="0 0 0.05"/>
        <body name="turret" pos="0 0 0.12"><joint name="base" axis="0 0 1"/>
          <geom type="cylinder" size="0.06 0.04" mass="0.8"/>
          <body name="upper_arm" pos="0 0 0.05"><joint name="shoulder" axis="0 1 0"/>
            <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="0.7"/>
            <body name="forearm" pos="0 0 0.3"><joint name="elbow" axis="0 1 0" frictionloss="{friction}"/>
              <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.025" mass="0.4"/>
              <site name="tool" pos="0.25 0 0"/>{load}
      </body></body></body></worldbody>
      <actuator>{servos}</actuator></mujoco>"""


def servo(gain=1.0, friction=0.0, step=0.002):
    """MJCF of a pendulum on one servo."""
    return f"""<mujoco model="servo"><option timestep="{step}" integrator="implicitfast"/>
      <default><geom contype="0" conaffinity="0"/></default>
      <worldbody><geom type="box" size="0.02 0.02 0.05" pos="0 0.04 0"/>
        <body name="lever"><joint name="shaft" axis="0 1 0" armature="0.002" damping="0.01" frictionloss="{friction}"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.008" mass="0.03"/>
          <geom type="sphere" size="0.03" pos="0 0 -0.1" mass="0.4"/><site name="load" pos="0 0 -0.1"/>
      </body></worldbody>
      <actuator><position name="servo" joint="shaft" kp="{3 * gain}" kv="{0.1 * gain}" ctrlrange="-2 2"/></actuator>
      </mujoco>"""


def commands(rng, count, reach):
    """(n, count) rad: sums of sines, and steps in the last third."""
    t = PERIOD * np.arange(round(SECONDS / PERIOD))
    f, phase = rng.uniform(0.15, 1.0, (3, count)), rng.uniform(0, 2 * np.pi, (3, count))
    sines = reach / 2 * np.sin(2 * np.pi * f * t[:, None, None] + phase).sum(axis=1) * np.minimum(t, 1.0)[:, None]
    steps = np.repeat(reach * rng.uniform(-1, 1, (len(t) // 80 + 1, count)), 80, axis=0)[: len(t)]
    return t, np.where(t[:, None] < 2 * SECONDS / 3, sines, steps)


def logged(xml, delay, rng, reach):
    """A run of a MuJoCo robot: what was sent, and what its encoders said."""
    model = mujoco.MjModel.from_xml_string(xml)
    data, held = mujoco.MjData(model), round(delay / STEP)
    t, sent = commands(rng, model.nu, reach)
    steps = round(PERIOD / STEP)
    rows, late = [], np.repeat(sent, steps, axis=0)
    for k in range(len(t)):
        rows.append(data.qpos + NOISE * rng.standard_normal(model.nq))
        for i in range(k * steps, (k + 1) * steps):
            data.ctrl[:] = late[i - held] if i >= held else 0.0
            mujoco.mj_step(model, data)
    joints, motors = ([mujoco.mj_id2name(model, kind, i) for i in range(n)]
                      for kind, n in ((mujoco.mjtObj.mjOBJ_JOINT, model.nq), (mujoco.mjtObj.mjOBJ_ACTUATOR, model.nu)))
    columns = {f"command.{m}": sent[:, i] for i, m in enumerate(motors)}
    return pd.DataFrame({"t": t, **columns, **{f"position.{j}": np.array(rows)[:, i] for i, j in enumerate(joints)}})


def driven(rng):
    """A run of the rover: wheel speeds that were sent, and its pose from a localisation."""
    t = 0.05 * np.arange(round(2 * SECONDS / 0.05))
    sent = np.repeat(rng.uniform(2, 8, (len(t) // 40, 2)), 40, axis=0)
    speed = ROVER["wheel_radius"] * sent * [1.0, ROVER["right"]]
    forward, turn = speed.mean(axis=1), (speed[:, 1] - speed[:, 0]) / (ROVER["track"] * ROVER["track_width"])
    theta = 0.05 * np.concatenate([[0.0], np.cumsum(turn)[:-1]])
    middle = theta + 0.025 * turn
    step = 0.05 * forward[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1)
    xy = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)[:-1]])
    pose = np.column_stack([xy, theta]) + [0.003, 0.003, 0.005] * rng.standard_normal((len(t), 3))
    names = ["command.left", "command.right", "pose.x", "pose.y", "pose.theta"]
    return pd.DataFrame(np.column_stack([t, sent, pose]), columns=["t", *names])


def main(situation, folder):
    """Write the robot and its runs; returns what is hidden."""
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    runs = [np.random.default_rng([7, k]) for k in range(3)]
    if situation == "drift":
        parameters = "".join(f"{k} = {ROVER[k]}\n" for k in ("wheel_radius", "track_width"))
        (out / "robot.toml").write_text(f'name = "rover"\nplant = "diff_drive"\n[parameters]\n{parameters}')
        tables, hidden = [driven(rng) for rng in runs], {k: ROVER[k] for k in ("right", "track")}
    else:
        one = situation == "servo"
        hidden = SERVO if one else ARMS[situation]
        real = {k: v for k, v in hidden.items() if k != "delay"}
        site, build = ("load", servo) if one else ("tool", arm)
        (out / "model.xml").write_text(build())
        text = f'name = "{situation}"\nplant = "mujoco"\nmodel = "model.xml"\npayload_site = "{site}"\n'
        (out / "robot.toml").write_text(text)
        delay, reach = hidden.get("delay", 0.0), 1.0 if one else 0.6
        tables = [logged(build(**real, step=STEP), delay, rng, reach) for rng in runs]
    for k, table in enumerate(tables):
        table.round(6).to_csv(out / f"run{k + 1}.csv", index=False)
    return hidden


if __name__ == "__main__":
    print("hidden:", main(*sys.argv[1:]))
