"""A torque-controlled arm from an HDF5 file: torques, positions, velocities -> causes -> MPC with the corrected model.

    python docs/examples/torque_arm_hdf5.py FOLDER

The arm is simulated here; with one of your own, begin at `main` with your file. Needs residual-mpc[arm,hdf5].
"""

import sys
from pathlib import Path

import h5py
import mujoco
import numpy as np

import residual_mpc as rm
from residual_mpc.closed_loop.scenario import RunOptions
from scenarios.own import OwnScenario

HIDDEN = {"coulomb_friction": 0.8, "payload": 0.3}  # N m in the elbow, kg: what the arm really has
FINE = 0.00025  # s, with Runge-Kutta; the program steps by 2.5 ms with another integrator
NOISE = {"position": 5e-4, "velocity": 1e-2}  # rad, rad/s
NAMES = ("base", "shoulder", "elbow")
HOME = np.array([0.0, 0.5, 0.8])  # rad, from hanging straight down


def mjcf(step=0.0025, integrator="implicitfast", payload=0.0):
    """The arm, hung from a beam, as its model has it or with something in its hand."""
    load = f'<geom type="sphere" size="0.01" mass="{payload}" pos="0 0 -0.3"/>' if payload else ""
    motors = "".join(f'<motor name="{n}" joint="{n}" ctrlrange="-40 40"/>' for n in NAMES)
    home = " ".join(map(str, HOME))
    return f"""<mujoco model="arm"><option timestep="{step}" integrator="{integrator}"/>
      <default><geom contype="0" conaffinity="0"/><joint armature="0.05" damping="3" range="-150 150"/></default>
      <worldbody>
        <body name="column"><joint name="base" axis="0 0 1"/>
          <geom type="cylinder" size="0.06 0.1" mass="3"/>
          <body name="upper_arm" pos="0 0 -0.1"><joint name="shoulder" axis="0 1 0"/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.04" mass="2.5"/>
            <body name="forearm" pos="0 0 -0.35"><joint name="elbow" axis="0 1 0"/>
              <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1.2"/>
              <site name="tool" pos="0 0 -0.3"/>{load}
      </body></body></body></worldbody>
      <actuator>{motors}</actuator><keyframe><key name="home" qpos="{home}"/></keyframe></mujoco>"""


class Arm:
    """The real arm. As a plant of the closed loop it has actuators, channels, and the five methods below."""

    actuators = NAMES
    channels = tuple(f"{kind}.{n}" for kind in NOISE for n in NAMES)

    def __init__(self, robot=None, period=0.01):
        self.model = mujoco.MjModel.from_xml_string(mjcf(FINE, "RK4", HIDDEN["payload"]))
        self.data = mujoco.MjData(self.model)

    def start(self, rng, at):
        self.rng = rng
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.data.qpos[:] = [at[c] for c in self.channels[:3]]
        return self

    def truth(self):
        return dict(zip(self.channels, [*self.data.qpos, *self.data.qvel], strict=True))

    def measure(self):
        noise = np.repeat([*NOISE.values()], 3) * self.rng.standard_normal(6)
        return {c: x + e for (c, x), e in zip(self.truth().items(), noise, strict=True)}

    def step(self, command, dt):
        self.data.ctrl[:] = command
        for _ in range(round(dt / FINE)):
            self.data.qfrc_applied[2] = -HIDDEN["coulomb_friction"] * np.tanh(self.data.qvel[2] / 0.002)
            mujoco.mj_step(self.model, self.data)

    def close(self):
        pass


def record(file, name, seed, seconds=8.0, dt=0.005):
    """A group of an HDF5 file: a motion by sums of sines, driven by the model's gravity torques and a PD controller."""
    rng = np.random.default_rng(seed)
    f, phase = rng.uniform(0.1, 0.6, (3, 3)), rng.uniform(0, 6.28, (3, 3))
    nominal = mujoco.MjModel.from_xml_string(mjcf())
    data, arm = mujoco.MjData(nominal), Arm().start(rng, dict(zip(Arm.channels, HOME, strict=False)))
    t = dt * np.arange(round(seconds / dt))
    torque, seen = np.empty((len(t), 3)), np.empty((len(t), 6))
    for k, now in enumerate(t):
        seen[k] = [*arm.measure().values()]
        swing = min(1.0, now) * (0.25 * np.sin(2 * np.pi * f * now + phase)).sum(axis=0)
        data.qpos[:], data.qvel[:] = seen[k, :3], seen[k, 3:]
        mujoco.mj_forward(nominal, data)
        pd = 60 * (HOME + swing - seen[k, :3]) - 6 * seen[k, 3:]
        torque[k] = np.clip(data.qfrc_bias + pd, -40, 40)
        arm.step(torque[k], dt)
    group = file.create_group(name)
    group["t"] = t
    for column, values in (("command", torque), ("position", seen[:, :3]), ("velocity", seen[:, 3:])):
        group[column] = values
        group[column].attrs["names"] = NAMES


def main(folder):
    """Log, model, diagnosis and closed loop in a folder; returns what was found."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with h5py.File(folder / "log.h5", "w") as file:
        for k in range(3):
            record(file, f"motion{k + 1}", seed=k)
    (folder / "arm.xml").write_text(mjcf())

    robot = rm.load_robot(folder / "arm.xml")  # the log's names are the model's: no robot file is needed
    runs = rm.read_runs(robot, folder / "log.h5")
    print(rm.check(robot, runs))
    print(rm.measure_gap(robot, runs))
    diagnosis = rm.diagnose(robot, runs, out=folder / "out")
    print(diagnosis, f"hidden: {HIDDEN}", sep="\n")

    model = rm.augment(robot, diagnosis, dt=0.01)
    noise = dict.fromkeys(Arm.channels[:3], NOISE["position"])
    result = OwnScenario(robot, model, "sines", plant=Arm, noise=noise).run(RunOptions(seeds=1))
    for name, each in result["controllers"].items():
        print(f"{name}: {1e3 * each['tracking_rmse']:.1f} mrad off the motion")
    return {"diagnosis": diagnosis, "controllers": result["controllers"]}


if __name__ == "__main__":
    main(sys.argv[1])
