"""A robot on four wheels as it really is: rigid bodies on contacts, stepped by MuJoCo; its drives are those of a rover.

In every turn all four wheels slide sideways, so that the track that a differential drive needs to describe it is wider
than the one that it has, and neither quite constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import mujoco
import numpy as np

from plants.blind_families.wheeled.truth import GRAVITY, Array, Drive, Policy, Trajectory, WheeledTruth
from plants.mujoco_log import silence_mujoco

_STEP = 1.5e-3  # s, of a usual robot
_USUAL_RADIUS = 0.067  # m
_USUAL_MASS = 5.0  # kg
_SETTLE = 0.4  # s, of a usual robot
_SERVO_TIME = 5e-4  # s, of a usual robot: sliding takes much torque, which a softer servo gives for large errors only
_CORNERS = ((1, 1), (1, -1), (-1, 1), (-1, -1))  # front or rear, left or right


@dataclass(frozen=True)
class Skidder:
    """The bodies. wheel_radius, track_width: m, as a tape measures them; wheelbase: m; friction: of tyre and floor."""

    wheel_radius: float
    track_width: float
    wheelbase: float
    friction: float

    @property
    def size(self) -> float:
        """Of its lengths beside those of a usual robot; times grow with the root of it, masses with its cube."""
        return self.wheel_radius / _USUAL_RADIUS

    @property
    def mass(self) -> float:
        """kg"""
        return _USUAL_MASS * self.size**3

    @property
    def stiffness(self) -> float:
        """N m s/rad of the wheels' servos, which have no integral part"""
        return 0.25 * self.mass * self.wheel_radius**2 / (_SERVO_TIME * sqrt(self.size))

    def simulate(
        self,
        truth: WheeledTruth,
        t: Array,
        policy: Policy,
        play: tuple[float, float] = (0.0, 0.0),
        *,
        change: tuple[float, WheeledTruth] | None = None,
    ) -> Trajectory:
        """See ``wheeled.truth.simulate``; of the truth, drives and sizes count, and sizes do not change in mid-run."""
        pace = sqrt(self.size)
        model = mujoco.MjModel.from_xml_string(_mjcf(self, truth))
        data = mujoco.MjData(model)
        silence_mujoco()
        stiffness = self.stiffness
        most = 0.5 * self.mass * GRAVITY * self.wheel_radius  # N m
        side = np.array([0 if left > 0 else 1 for _, left in _CORNERS])
        drives, wanted = (Drive(truth, 0, play[0]), Drive(truth, 1, play[1])), np.zeros(2)

        def advance(h: float) -> None:
            model.opt.timestep = h
            turning = data.qvel[6:]
            # MuJoCo takes the joints' damping, which is the servo's, at the end of the step
            data.qfrc_applied[6:] = np.clip(stiffness * (wanted[side] - turning), -most, most) + stiffness * turning
            mujoco.mj_step(model, data)

        for _ in range(round(_SETTLE / _STEP)):
            advance(_STEP * pace)
        data.qpos[:2] = 0.0
        rows = [(float(t[0]), *_planar(data), 0.0, 0.0)]
        sent: list[tuple[float, float]] = []
        stamps, used, p = [*map(float, t), float(t[-1])], 0.0, truth
        for k in range(len(t)):
            now, until = stamps[k], stamps[k + 1]
            if change is not None and now >= change[0]:
                p = drives[0].truth = drives[1].truth = change[1]
            sent.append(policy(k, *rows[-1][1:4]))
            for drive, value in zip(drives, sent[-1], strict=True):
                drive.send(now, value)
            n = ceil((until - now) / (_STEP * pace) - 1e-9)
            for j in range(n):
                h = (until - now) / n
                at = now + j * h
                wanted[:] = [drive.step(at, h, max(1.0 - used, 0.05)) for drive in drives]
                used += h * p.sag * (0.7 + 0.3 * float(np.hypot(*wanted)) / (0.6 * p.speed_scale))
                advance(h)
                turned = data.qvel[6:]
                rows.append((at + h, *_planar(data), float(turned[[0, 2]].mean()), float(turned[[1, 3]].mean())))
        table = np.array(rows)
        heading = np.unwrap(table[:, 3])
        return Trajectory(table[:, 0], table[:, 1], table[:, 2], heading, table[:, 4:6], np.array(sent))


def _planar(data: mujoco.MjData) -> tuple[float, float, float]:
    x, y = data.qpos[:2]
    w, i, j, k = data.qpos[3:7]
    return float(x), float(y), float(np.arctan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))


def _mjcf(robot: Skidder, truth: WheeledTruth) -> str:
    r, mass = robot.wheel_radius, robot.mass
    half, width = 0.5 * robot.track_width * truth.track, 0.2 * r
    wheels = ""
    for number, (front, left) in enumerate(_CORNERS):
        radius = r * truth.radius[0 if left > 0 else 1]
        at = f"{front * 0.5 * robot.wheelbase:.9g} {left * half:.9g} {radius - 1.2 * r:.9g}"
        wheels += (
            f'<body pos="{at}"><joint axis="0 1 0" armature="{0.08 * mass * r**2:.9g}" '
            f'damping="{robot.stiffness:.9g}"/>'
            f'<geom name="wheel{number}" type="ellipsoid" size="{radius:.9g} {width:.9g} {radius:.9g}" '
            f'mass="{0.04 * mass:.9g}"/></body>'
        )
    stiff = f'solref="{0.008 * sqrt(robot.size):.9g} 1" friction="{robot.friction:.9g} 0.001 0.00001"'
    box = f"{0.5 * robot.wheelbase + r:.9g} {0.4 * robot.track_width:.9g} {0.4 * r:.9g}"
    return (
        f'<mujoco><option cone="elliptic" impratio="10" integrator="implicitfast"/><default><geom {stiff}/></default>'
        '<worldbody><geom type="plane" size="0 0 1"/>'
        f'<body pos="0 0 {1.2 * r:.9g}"><freejoint/>'
        f'<geom type="box" size="{box}" mass="{0.84 * mass:.9g}" contype="0" conaffinity="0"/>'
        f"{wheels}</body></worldbody></mujoco>"
    )
