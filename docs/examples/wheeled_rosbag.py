"""A wheeled robot from a rosbag: bags of /cmd_vel, /pose and /joint_states -> causes -> MPC with the corrected model.

    python docs/examples/wheeled_rosbag.py FOLDER

The robot is simulated here; with one of your own, begin at `main` with your bags. Needs residual-mpc[mpc,rosbag].
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import residual_mpc as rm
from residual_mpc.closed_loop.scenario import RunOptions
from scenarios.own import OwnScenario, Waypoints

RADIUS, TRACK = 0.033, 0.16  # m, what the model says
HIDDEN = {"command_delay": 0.12, "track_width": 1.12}  # s, and times as wide: what the robot really does
FINE = 0.001  # s, Euler's step; the program integrates in another way
NOISE = np.array([0.001, 0.001, 0.003])  # m, m, rad, of motion capture


class Rover:
    """The robot. As a plant of the closed loop it has actuators, channels, and the five methods below."""

    actuators = ("left", "right")
    channels = ("pose.x", "pose.y", "pose.theta")

    def __init__(self, robot=None, period=0.05):
        self.waiting = round(HIDDEN["command_delay"] / FINE)

    def start(self, rng, at):
        self.rng, self.pose = rng, np.array([at[c] for c in self.channels])
        self.sent = [np.zeros(2)] * self.waiting
        return self

    def measure(self):
        return dict(zip(self.channels, self.pose + NOISE * self.rng.standard_normal(3), strict=True))

    def truth(self):
        return dict(zip(self.channels, self.pose, strict=True))

    def step(self, command, dt):
        for _ in range(round(dt / FINE)):
            self.sent.append(np.array(command))
            self.wheels = self.sent.pop(0)  # rad/s
            v, w = RADIUS * self.wheels.mean(), RADIUS * np.diff(self.wheels)[0] / (HIDDEN["track_width"] * TRACK)
            self.pose = self.pose + FINE * np.array([v * np.cos(self.pose[2]), v * np.sin(self.pose[2]), w])

    def close(self):
        pass


def record(folder, seed, seconds=30.0, dt=0.05):
    """A bag of a drive by sums of sines, as ROS 2 would record it."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    T, rng = store.types, np.random.default_rng(seed)
    f, phase = rng.uniform(0.1, 0.6, (3, 2)), rng.uniform(0, 6.28, (3, 2))

    def header(ns):
        time = T["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return T["std_msgs/msg/Header"](stamp=time, frame_id="world")

    def vector(x=0.0, y=0.0, z=0.0, kind="Vector3"):
        return T[f"geometry_msgs/msg/{kind}"](x=x, y=y, z=z)

    def messages(ns, body, pose, wheels):
        twist = T["geometry_msgs/msg/Twist"](linear=vector(body[0]), angular=vector(z=body[1]))
        turn = T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sin(pose[2] / 2), w=np.cos(pose[2] / 2))
        place = T["geometry_msgs/msg/Pose"](position=vector(pose[0], pose[1], kind="Point"), orientation=turn)
        yield "/cmd_vel", T["geometry_msgs/msg/TwistStamped"](header=header(ns), twist=twist)
        yield "/pose", T["geometry_msgs/msg/PoseStamped"](header=header(ns), pose=place)
        yield "/joint_states", T["sensor_msgs/msg/JointState"](
            header=header(ns), name=["wheel_left_joint", "wheel_right_joint"], position=np.array([]),
            velocity=wheels, effort=np.array([]),
        )  # fmt: skip

    robot = Rover().start(rng, dict.fromkeys(Rover.channels, 0.0))
    robot.wheels = np.zeros(2)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        topics = {}
        for k in range(round(seconds / dt)):
            u = (3.0 * np.sin(2 * np.pi * f * k * dt + phase)).sum(axis=0)
            body = (RADIUS * u.mean(), RADIUS * np.diff(u)[0] / TRACK)
            ns = 1_760_000_000_000_000_000 + round(k * dt * 1e9)
            for topic, message in messages(ns, body, [*robot.measure().values()], robot.wheels.copy()):
                kind = message.__msgtype__
                if topic not in topics:
                    topics[topic] = bag.add_connection(topic, kind, typestore=store)
                bag.write(topics[topic], ns + 1_000_000, store.serialize_cdr(message, kind))
            robot.step(u, dt)


def main(folder):
    """Bags, robot file, diagnosis and closed loop in a folder; returns what was found."""
    folder = Path(folder)
    for k in range(3):
        record(folder / "bags" / f"drive{k + 1}", seed=k)

    init = ["residual-mpc", "init", "diff_drive", str(folder / "bags"), "--out", str(folder / "rover.toml")]
    subprocess.run(init, check=True)
    robot = rm.load_robot(folder / "rover.toml")
    runs = rm.read_runs(robot, folder / "bags")
    print(rm.check(robot, runs))
    print(rm.measure_gap(robot, runs))
    diagnosis = rm.diagnose(robot, runs, out=folder / "out")
    print(diagnosis, f"hidden: {HIDDEN}", sep="\n")

    t = np.linspace(0.0, 28.0, 561)
    turn = 2 * np.pi / 14 * np.where(t < 2, t * t / 4, t - 1)  # rad; starts slowly
    x, y = 0.5 * np.sin(turn), 0.25 * np.sin(2 * turn)  # m
    heading = np.unwrap(np.arctan2(np.cos(2 * turn), np.cos(turn)))
    path = Waypoints(Rover.channels, t, np.stack([x, y, heading], axis=-1))
    model = rm.augment(robot, diagnosis, dt=0.05)
    noise = dict(zip(Rover.channels, NOISE, strict=True))
    result = OwnScenario(robot, model, path, plant=Rover, noise=noise).run(RunOptions(seeds=1, out=folder / "drive"))
    for name, each in result["controllers"].items():
        print(f"{name}: {1e3 * each['tracking_rmse']:.1f} mm off the figure eight")
    return {"diagnosis": diagnosis, "controllers": result["controllers"]}


if __name__ == "__main__":
    main(sys.argv[1])
