"""A position-controlled arm from MCAP files: /joint_states and the commands -> causes -> MPC with the corrected model.

    python docs/examples/position_arm_mcap.py FOLDER

The arm is simulated here; with one of your own, begin at `main` with your files. Needs residual-mpc[arm,mcap].
"""

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

import residual_mpc as rm
from residual_mpc.closed_loop.scenario import RunOptions
from scenarios.own import OwnScenario

HIDDEN = {"command_delay": 0.04, "payload": 0.6}  # s, kg: what the arm really has
FINE = 0.0005  # s, with Runge-Kutta; the program steps by 4 ms with another integrator
NOISE = 1e-3  # rad, of the encoders
HOME = (0.0, 0.5, 1.0, 0.3, 0.0, 0.2)  # rad
LINKS = (  # joint, axis, length (m), mass (kg), kp (N m/rad), kv (N m s/rad)
    ("shoulder_pan", "0 0 1", 0.15, 3.0, 500, 50), ("shoulder_lift", "0 1 0", 0.40, 5.0, 500, 50),
    ("elbow", "0 1 0", 0.35, 2.5, 300, 25), ("wrist_1", "0 1 0", 0.10, 1.0, 100, 5),
    ("wrist_2", "0 0 1", 0.10, 0.8, 80, 3), ("wrist_3", "0 1 0", 0.08, 0.3, 50, 1),
)  # fmt: skip


def mjcf(step=0.004, integrator="implicitfast", payload=0.0):
    """The arm, as its model has it or with something in its gripper."""
    inner = f'<site name="tool" pos="0 0 {LINKS[-1][2]}"/>'
    if payload:
        inner += f'<geom name="load" type="sphere" size="0.01" mass="{payload}" pos="0 0 {LINKS[-1][2]}"/>'
    bodies, actuators = inner, ""
    for (name, axis, length, mass, kp, kv), below in zip(LINKS[::-1], (*(k[2] for k in LINKS[-2::-1]), 0), strict=True):
        actuators = f'<position name="{name}" joint="{name}" kp="{kp}" kv="{kv}" ctrlrange="-3 3"/>' + actuators
        bodies = f"""<body name="{name}_link" pos="0 0 {below}">
          <joint name="{name}" axis="{axis}" range="-180 180" armature="0.1" damping="0.5"/>
          <geom type="capsule" fromto="0 0 0 0 0 {length}" size="0.04" mass="{mass}"/>{bodies}</body>"""
    home = " ".join(map(str, HOME))
    return f"""<mujoco model="arm"><option timestep="{step}" integrator="{integrator}"/>
      <default><geom contype="0" conaffinity="0"/></default><worldbody>{bodies}</worldbody>
      <actuator>{actuators}</actuator><keyframe><key name="home" qpos="{home}" ctrl="{home}"/></keyframe></mujoco>"""


class Arm:
    """The real arm. As a plant of the closed loop it has actuators, channels, and the five methods below."""

    actuators = tuple(link[0] for link in LINKS)
    channels = tuple(f"position.{name}" for name in actuators)

    def __init__(self, robot=None, period=0.02):
        self.model = mujoco.MjModel.from_xml_string(mjcf(FINE, "RK4", HIDDEN["payload"]))
        self.data = mujoco.MjData(self.model)

    def start(self, rng, at):
        self.rng = rng
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[:] = [at[c] for c in self.channels]
        self.sent = [self.data.qpos.copy()] * round(HIDDEN["command_delay"] / FINE)
        return self

    def measure(self):
        return dict(zip(self.channels, self.data.qpos + NOISE * self.rng.standard_normal(6), strict=True))

    def truth(self):
        return dict(zip(self.channels, self.data.qpos, strict=True))

    def step(self, command, dt):
        for _ in range(round(dt / FINE)):
            self.sent.append(np.array(command))
            self.data.ctrl[:] = self.sent.pop(0)
            mujoco.mj_step(self.model, self.data)

    def close(self):
        pass


def record(path, seed, seconds=8.0, dt=0.01):
    """An MCAP file of a motion by sums of sines, as ROS 2 would record it."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    T, rng = store.types, np.random.default_rng(seed)
    f, phase = rng.uniform(0.1, 0.5, (3, 6)), rng.uniform(0, 6.28, (3, 6))

    def messages(ns, command, position):
        time = T["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        header, layout = T["std_msgs/msg/Header"](time, ""), T["std_msgs/msg/MultiArrayLayout"]([], 0)
        names, none = [f"{a}_joint" for a in Arm.actuators], np.array([])
        yield "/joint_states", T["sensor_msgs/msg/JointState"](header, names, position, none, none)
        yield "/forward_position_controller/commands", T["std_msgs/msg/Float64MultiArray"](layout, command)

    arm = Arm().start(rng, dict(zip(Arm.channels, HOME, strict=True)))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        writer, topics = Writer(file), {}
        writer.start("ros2")
        for k in range(round(seconds / dt)):
            swing = (0.2 * np.sin(2 * np.pi * f * k * dt + phase)).sum(axis=0)
            command = HOME + min(1.0, k * dt) * swing
            ns = 1_760_000_000_000_000_000 + round(k * dt * 1e9)
            for topic, message in messages(ns, command, np.array([*arm.measure().values()])):
                kind = message.__msgtype__
                if topic not in topics:
                    text = store.generate_msgdef(kind, ros_version=2)[0].encode()
                    topics[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text))
                writer.add_message(topics[topic], ns, bytes(store.serialize_cdr(message, kind)), ns)
            arm.step(command, dt)
        writer.finish()


def main(folder):
    """Recordings, robot file, diagnosis and closed loop in a folder; returns what was found."""
    folder = Path(folder)
    for k in range(3):
        record(folder / "runs" / f"motion{k + 1}.mcap", seed=k)
    (folder / "arm.xml").write_text(mjcf())

    init = ["residual-mpc", "init", str(folder / "arm.xml"), str(folder / "runs"), "--out", str(folder / "arm.toml")]
    subprocess.run(init, check=True)
    robot = rm.load_robot(folder / "arm.toml")
    runs = rm.read_runs(robot, folder / "runs")
    print(rm.check(robot, runs))
    print(rm.measure_gap(robot, runs))
    diagnosis = rm.diagnose(robot, runs, out=folder / "out")
    print(diagnosis, f"hidden: {HIDDEN}", sep="\n")

    model = rm.augment(robot, diagnosis, dt=0.02)
    noise = dict.fromkeys(Arm.channels, NOISE)
    result = OwnScenario(robot, model, "sines", plant=Arm, noise=noise).run(RunOptions(seeds=1))
    for name, each in result["controllers"].items():
        print(f"{name}: {1e3 * each['tracking_rmse']:.1f} mrad off the motion")
    return {"diagnosis": diagnosis, "controllers": result["controllers"]}


if __name__ == "__main__":
    main(sys.argv[1])
