"""A hobby arm from a LeRobot data set: action and observation.state -> causes -> MPC with the corrected model.

    python docs/examples/lerobot_arm.py FOLDER

The arm is simulated here; with one of your own, begin at `main` with your data set. Needs residual-mpc[arm].
"""

import json
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import residual_mpc as rm
from residual_mpc.closed_loop.scenario import RunOptions
from scenarios.own import OwnScenario

HIDDEN = {"command_delay": 0.07, "coulomb_friction": 0.25}  # s, N m in the elbow: what the arm really has
FINE = 0.0005  # s, with Runge-Kutta; the program steps by 5 ms with another integrator
NOISE = 4e-4  # rad, of the encoders
NAMES = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex")
HOME = np.array([0.0, -0.4, 0.8, 0.3])  # rad
FPS = 30


def mjcf(step=0.005, integrator="implicitfast"):
    """The arm as its model has it."""
    gains = (18, 18, 18, 10)
    servos = "".join(
        f'<position name="{n}" joint="{n}" kp="{kp}" kv="{kp / 20}" ctrlrange="-1.8 1.8" forcerange="-3 3"/>'
        for n, kp in zip(NAMES, gains, strict=True)
    )
    home = " ".join(map(str, HOME))
    return f"""<mujoco model="hobby_arm"><option timestep="{step}" integrator="{integrator}"/>
      <default><geom contype="0" conaffinity="0"/><joint armature="0.03" damping="0.1" range="-110 110"/></default>
      <worldbody>
        <body name="base"><joint name="shoulder_pan" axis="0 0 1"/><geom type="cylinder" size="0.04 0.03" mass="0.15"/>
          <body name="upper_arm" pos="0 0 0.06"><joint name="shoulder_lift" axis="0 1 0"/>
            <geom type="capsule" fromto="0 0 0 0 0 0.115" size="0.02" mass="0.15"/>
            <body name="lower_arm" pos="0 0 0.115"><joint name="elbow_flex" axis="0 1 0"/>
              <geom type="capsule" fromto="0 0 0 0 0 0.135" size="0.02" mass="0.12"/>
              <body name="wrist" pos="0 0 0.135"><joint name="wrist_flex" axis="0 1 0"/>
                <geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.02" mass="0.15"/>
                <site name="gripper" pos="0 0 0.1"/>
      </body></body></body></body></worldbody>
      <actuator>{servos}</actuator><keyframe><key name="home" qpos="{home}" ctrl="{home}"/></keyframe></mujoco>"""


class Arm:
    """The real arm. As a plant of the closed loop it has actuators, channels, and the five methods below."""

    actuators = NAMES
    channels = tuple(f"position.{n}" for n in NAMES)

    def __init__(self, robot=None, period=1 / FPS):
        self.model = mujoco.MjModel.from_xml_string(mjcf(FINE, "RK4"))
        self.data = mujoco.MjData(self.model)

    def start(self, rng, at):
        self.rng, self.time = rng, 0.0
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[:] = [at[c] for c in self.channels]
        self.sent = [self.data.qpos.copy()] * round(HIDDEN["command_delay"] / FINE)
        return self

    def truth(self):
        return dict(zip(self.channels, self.data.qpos, strict=True))

    def measure(self):
        return {c: x + NOISE * self.rng.standard_normal() for c, x in self.truth().items()}

    def step(self, command, dt):
        self.time += dt
        while self.data.time < self.time - FINE / 2:
            self.sent.append(np.array(command))
            self.data.ctrl[:] = self.sent.pop(0)
            self.data.qfrc_applied[2] = -HIDDEN["coulomb_friction"] * np.tanh(self.data.qvel[2] / 0.01)
            mujoco.mj_step(self.model, self.data)

    def close(self):
        pass


def episode(seed, seconds=10.0):
    """(n, 4) action and (n, 4) observation.state in degrees, as this kind of arm is recorded."""
    rng = np.random.default_rng(seed)
    f, phase = rng.uniform(0.1, 0.5, (3, 4)), rng.uniform(0, 6.28, (3, 4))
    arm, action, state = Arm().start(rng, dict(zip(Arm.channels, HOME, strict=True))), [], []
    for k in range(round(seconds * FPS)):
        swing = (0.25 * np.sin(2 * np.pi * f * k / FPS + phase)).sum(axis=0)
        action.append(HOME + min(1.0, k / FPS) * swing)
        state.append([*arm.measure().values()])
        arm.step(action[-1], 1 / FPS)
    return np.rad2deg(action), np.rad2deg(state)


def record(folder, episodes=3):
    """A data set in the layout of LeRobot's version 3.0, without images."""
    rows, total = [], 0
    for index in range(episodes):
        action, state = episode(index)
        for k, (a, s) in enumerate(zip(action.tolist(), state.tolist(), strict=True)):
            rows.append({"action": a, "observation.state": s, "timestamp": k / FPS, "frame_index": k,
                         "episode_index": index, "index": total, "task_index": 0})  # fmt: skip
            total += 1
    names = [f"{n}.pos" for n in NAMES]
    lists = {c: {"dtype": "float32", "shape": [len(names)], "names": names} for c in ("action", "observation.state")}
    types = {"timestamp": "float32", **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")}
    features = {**lists, **{c: {"dtype": d, "shape": [1], "names": None} for c, d in types.items()}}
    info = {
        "codebase_version": "v3.0", "robot_type": "hobby_arm", "fps": FPS, "total_episodes": episodes,
        "total_frames": total, "total_tasks": 1, "chunks_size": 1000, "splits": {"train": f"0:{episodes}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet", "features": features,
    }  # fmt: skip
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "data" / "chunk-000").mkdir(parents=True, exist_ok=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=2))
    schema = pa.schema(
        [(c, pa.list_(pa.float32(), len(names))) for c in lists] + [(c, pa.type_for_alias(d)) for c, d in types.items()]
    )
    pq.write_table(pa.Table.from_pylist(rows, schema), folder / "data" / "chunk-000" / "file-000.parquet")


def main(folder):
    """Data set, robot file, diagnosis and closed loop in a folder; returns what was found."""
    folder = Path(folder)
    record(folder / "set")
    (folder / "arm.xml").write_text(mjcf())

    init = ["residual-mpc", "init", str(folder / "arm.xml"), str(folder / "set"), "--out", str(folder / "arm.toml"),
            "--mended", str(folder / "radians")]  # fmt: skip
    subprocess.run(init, check=True)
    robot = rm.load_robot(folder / "arm.toml")
    runs = rm.read_runs(robot, folder / "radians")
    print(rm.check(robot, runs))
    print(rm.measure_gap(robot, runs))
    diagnosis = rm.diagnose(robot, runs, out=folder / "out")
    print(diagnosis, f"hidden: {HIDDEN}", sep="\n")

    model = rm.augment(robot, diagnosis, dt=1 / FPS)
    result = OwnScenario(robot, model, "sines", plant=Arm).run(RunOptions(seeds=1))
    for name, each in result["controllers"].items():
        print(f"{name}: {1e3 * each['tracking_rmse']:.1f} mrad off the motion")
    return {"diagnosis": diagnosis, "controllers": result["controllers"]}


if __name__ == "__main__":
    main(sys.argv[1])
