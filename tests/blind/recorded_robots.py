"""Robots whose runs the tests of known changes share: a rover integrated here, and arms that MuJoCo simulates."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.blind.recorded.half import Half, Setting
from residual_mpc.blind.recorded.log import Column, Log

STEP = 0.001  # s, of the integration
PERIOD = 0.02  # s, of the log
LIMIT = 6.0  # rad/s, of the wheels
GEOMETRY = {"wheel_radius": 0.1, "track_width": 0.5}
NOISE = {"pose.x": 1e-3, "pose.y": 1e-3, "pose.theta": 2e-3, "velocity.left": 0.01, "velocity.right": 0.01}


def commands(rng: np.random.Generator, seconds: float = 8.0) -> dict[str, Column]:
    """Held levels for both wheels, zero now and then, beyond the limit now and then."""
    t = PERIOD * np.arange(round(seconds / PERIOD) + 1)
    levels = rng.choice([0.0, 1.5, -2.0, 4.0, 7.5], (2, int(seconds / 0.5) + 2)) * rng.uniform(0.9, 1.1)
    part = (t / 0.5).astype(int)
    return {f"command.{side}": Column(t, levels[i, part]) for i, side in enumerate(("left", "right"))}


def drive(
    sent: Mapping[str, Column],
    stamps: np.ndarray,
    noise: np.random.Generator,
    *,
    delay: Mapping[str, float] | None = None,
    gain: Mapping[str, float] | None = None,
    zone: float = 0.0,
    late: float = 0.0,
    clock: float = 0.0,
    point: tuple[float, float] = (0.0, 0.0),
    bias: float = 0.0,
) -> dict[str, Column]:
    """What the sensors of a rover report to commands that were sent, stamped by the sensors' own clock.

    stamps: true times at which they sample. delay s and gain by wheel; zone rad/s of command; late s and clock (1) of
    the pose; point m that is tracked; bias rad of the heading.
    """
    begin = min(c.t[0] for c in sent.values())
    clocked = begin + STEP * np.arange(round((stamps[-1] - begin) / STEP) + 1)
    wheels = []
    for side in ("left", "right"):
        c = sent[f"command.{side}"]
        seen = clocked - (delay or {}).get(side, 0.0)
        u = c.values[np.clip(np.searchsorted(c.t, seen + 1e-9, side="right") - 1, 0, None)]
        u = np.where(seen + 1e-9 < c.t[0], 0.0, u)
        u = np.where(np.abs(u) < zone, 0.0, u) * (gain or {}).get(side, 1.0)
        w, speed = np.zeros(len(u)), 0.0
        for k, wanted in enumerate(np.clip(u, -LIMIT, LIMIT)):
            w[k] = speed
            speed += STEP / 0.08 * (wanted - speed)
        wheels.append(w)
    left, right = wheels
    forward = GEOMETRY["wheel_radius"] * (left + right) / 2
    theta = np.cumsum(np.append(0.0, GEOMETRY["wheel_radius"] * (right - left)[:-1] / GEOMETRY["track_width"] * STEP))
    x = np.cumsum(np.append(0.0, (forward * np.cos(theta))[:-1] * STEP))
    y = np.cumsum(np.append(0.0, (forward * np.sin(theta))[:-1] * STEP))
    at = np.round((stamps - begin) / STEP).astype(int)
    x, y, theta = x[at], y[at], theta[at]
    readings = {
        "pose.x": x + point[0] * np.cos(theta) - point[1] * np.sin(theta),
        "pose.y": y + point[0] * np.sin(theta) + point[1] * np.cos(theta),
        "pose.theta": theta + bias,
        "velocity.left": left[at],
        "velocity.right": right[at],
    }
    shown = stamps[0] + (stamps - stamps[0]) * (1.0 + clock) + late
    return {
        c: Column(shown if c.startswith("pose") else stamps, v + noise.normal(0, NOISE[c], len(v)))
        for c, v in readings.items()
    }


def rover_log(seed: int = 0, name: str = "after_run", seconds: float = 8.0) -> Log:
    """A run of the rover as it is."""
    sent = commands(np.random.default_rng(seed), seconds)
    t = sent["command.left"].t
    log = Log(name, {**sent, **drive(sent, t, np.random.default_rng(seed + 1))})
    return log.with_stamps(log.columns, lambda _: t)  # one clock, as in a log


def rover(*logs: Log) -> Half:
    return Half("rover", "diff_drive", logs or (rover_log(),), (Setting("*", "", GEOMETRY),))


ARM = """<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <default>
    <joint damping="0.3"/>
    <default class="servo">
      <joint armature="0.02" frictionloss="0.1"/>
      <position kp="30" kv="1.2" forcerange="-4 4"/>
    </default>
  </default>
  <option timestep="0.0005"/>
  <worldbody>
    <body name="upper" pos="0 0 1" childclass="servo">
      <joint name="shoulder" type="hinge" axis="0 -1 0"/>
      <inertial pos="0.02 0 -0.15" mass="0.6" fullinertia="0.006 0.006 0.001 0 0.0005 0"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" type="hinge" axis="0 -1 0"/>
        <inertial pos="0 0 -0.12" mass="0.5" diaginertia="0.004 0.004 0.001" quat="0.9238795 0 0.3826834 0"/>
        <site name="tip" pos="0 0 -0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position class="servo" name="m1" joint="shoulder"/>
    <motor name="m2" joint="elbow" gear="2"/>
  </actuator>
</mujoco>
"""


def arm_log(name: str = "after_run", late: float = 0.0) -> Log:
    """Both joints swinging; late s: when the shoulder's sensor reports."""
    t = 0.01 * np.arange(600)
    seen = {"shoulder": 0.8 * np.sin(3.0 * t), "elbow": 0.5 * np.sin(5.0 * t + 1.0)}
    columns = {"command.m1": Column(t, np.sin(3.0 * t)), "command.m2": Column(t, np.cos(5.0 * t))}
    columns |= {f"position.{j}": Column(t + late if j == "shoulder" else t, y) for j, y in seen.items()}
    return Log(name, columns)


def arm(model: str = ARM) -> Half:
    log = arm_log()
    t = log.columns["command.m1"].t
    return Half("arm", "mujoco", (log.with_stamps(log.columns, lambda _: t),), (Setting("*", model, {}),), "tip")
