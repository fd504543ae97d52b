"""Arms written by hand: a six-joint arm like a UR5e, a heavy one, and a seven-joint arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.findings.arms import Servos


@dataclass(frozen=True)
class Link:
    """A link along z or x: its joint's axis, the place of its joint in the link before (m), mass (kg), length (m)."""

    axis: str
    pos: str
    mass: float
    to: str  # the far end in the link's frame (m)
    armature: float = 0.1
    damping: float = 1.0
    size: float = 0.045


@dataclass(frozen=True)
class ArmModel:
    """Links from the base on and their servos; the file is written in degrees, as is MJCF's default."""

    name: str
    links: Sequence[Link]
    servos: Servos

    def xml(self, payload: float = 0.0) -> str:
        """The MJCF, with `payload` (kg) at the tool."""
        bodies = [self._open(k, link) for k, link in enumerate(self.links, start=1)]
        tool = self.links[-1].to
        carried = f'<geom type="sphere" size="0.001" pos="{tool}" mass="{payload}"/>' if payload else ""
        actuators = "".join(self._actuator(k) for k in range(len(self.links)))
        return (
            f'<mujoco model="{self.name}"><option timestep="0.002" integrator="implicitfast"/>\n'
            '<default><geom contype="0" conaffinity="0"/></default>\n<worldbody>\n'
            + "\n".join(bodies)
            + f'\n<site name="tool" pos="{tool}"/>{carried}\n'
            + "</body>" * len(self.links)
            + f"\n</worldbody>\n<actuator>\n{actuators}</actuator></mujoco>\n"
        )

    def _open(self, number: int, link: Link) -> str:
        return (
            f'<body name="link{number}" pos="{link.pos}"><joint name="j{number}" axis="{link.axis}" range="-360 360" '
            f'armature="{link.armature}" damping="{link.damping}"/>'
            f'<geom type="capsule" fromto="0 0 0 {link.to}" size="{link.size}" mass="{link.mass}"/>'
        )

    def _actuator(self, k: int) -> str:
        s, names = (
            self.servos,
            f'name="m{k + 1}" joint="j{k + 1}" forcerange="{-self.servos.force[k]} {self.servos.force[k]}"',
        )
        if not s.kp.any():
            return f"<motor {names}/>\n"
        return f'<general {names} biastype="affine" gainprm="{s.kp[k]}" biasprm="0 {-s.kp[k]} {-s.kv[k]}"/>\n'


SIX = ArmModel(
    "six_joint",
    (
        Link("0 0 1", "0 0 0.16", 3.76, "0 0.13 0", 0.3),
        Link("0 1 0", "0 0.13 0", 8.06, "0.425 0 0", 0.3),
        Link("0 1 0", "0.425 -0.12 0", 2.85, "0.392 0 0", 0.3),
        Link("0 1 0", "0.392 0 0", 1.37, "0 0.12 0", 0.1),
        Link("0 0 1", "0 0.12 0", 1.3, "0 0 -0.1", 0.1),
        Link("0 1 0", "0 0 -0.1", 0.37, "0 0.1 0", 0.1),
    ),
    Servos(
        np.array([2000.0, 2000, 2000, 500, 500, 500]),
        np.array([250.0, 250, 250, 60, 60, 60]),
        np.array([150.0, 150, 150, 28, 28, 28]),
    ),
)

HEAVY = ArmModel(
    "heavy_six_joint",
    (
        Link("0 0 1", "0 0 0.2", 9.0, "0 0 0.15", 0.5),
        Link("0 1 0", "0 0 0.15", 11.0, "0 0 0.45", 0.5),
        Link("0 1 0", "0 0 0.45", 7.0, "0.2 0 0.35", 0.3),
        Link("1 0 0", "0.2 0 0.35", 3.0, "0.15 0 0", 0.05, 0.3),
        Link("0 1 0", "0.15 0 0", 2.0, "0.12 0 0", 0.05, 0.3),
        Link("1 0 0", "0.12 0 0", 1.0, "0.08 0 0.04", 0.03, 0.2),
    ),
    Servos(np.zeros(6), np.zeros(6), np.array([300.0, 300, 200, 60, 60, 30])),
)

SEVEN = ArmModel(
    "seven_joint",
    (
        Link("0 0 1", "0 0 0.15", 3.5, "0 0 0.18", 0.1, 0.5),
        Link("0 1 0", "0 0 0.18", 3.5, "0 0 0.2", 0.1, 0.5),
        Link("0 0 1", "0 0 0.2", 2.8, "0.08 0 0.12", 0.1, 0.5),
        Link("0 -1 0", "0.08 0 0.12", 2.6, "-0.08 0 0.15", 0.1, 0.5),
        Link("0 0 1", "-0.08 0 0.15", 2.2, "0 0 0.2", 0.08, 0.4),
        Link("0 -1 0", "0 0 0.2", 1.4, "0.09 0 0", 0.05, 0.3),
        Link("0 0 1", "0.09 0 0", 0.7, "0 0 -0.12", 0.05, 0.3),
    ),
    Servos(
        np.array([400.0, 400, 300, 300, 150, 100, 60]),
        np.array([40.0, 40, 30, 30, 15, 10, 6]),
        np.array([87.0, 87, 87, 87, 12, 12, 12]),
    ),
)
