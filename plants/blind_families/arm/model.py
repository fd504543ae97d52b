"""Serial arms drawn at random: the nominal MJCF that the user has, and the facts the truth starts from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from plants.blind_families.arm.flaws import built_in
from plants.blind_families.arm.gear import GearLaw
from plants.blind_families.arm.truth import STEP, ArmTruth, Rigid

Array = NDArray[np.float64]
NOMINAL_STEP = 0.001  # s


@dataclass(frozen=True)
class Arm:
    """One nominal arm of n hinges; every array is (n,)."""

    axes: tuple[str, ...]  # "y" pitches, "z" yaws, in the link's frame, whose x runs along the link
    length: Array  # m
    mass: Array  # kg
    radius: Array  # m, of the link's capsule
    armature: Array  # kg m^2
    damping: Array  # N m s/rad
    kind: str  # position, velocity or torque: what the actuators take
    kp: Array  # N m/rad
    kv: Array  # N m s/rad
    home: Array  # rad, the pose that motions are centred on

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(f"j{i + 1}" for i in range(len(self.axes)))

    @property
    def stop(self) -> Array:
        """N m at which the actuators stop: never."""
        return np.full(len(self.axes), np.inf)

    def rigid(self, truth: ArmTruth) -> Rigid:
        """See ``arm.truth.NominalArm``: an open chain, so that every joint has a motor."""
        model = compiled(truth, self)
        places = np.array([model.joint(name).qposadr[0] for name in self.joints])  # links that bend have joints as well
        return Rigid(model, places, lambda q, v: None, gear_law(truth, self))

    def write_model(self, folder: Path) -> list[str]:
        """See ``arm.truth.NominalArm``."""
        (folder / "arm.xml").write_text(mjcf(self))
        return ['plant = "mujoco"', 'model = "arm.xml"', 'payload_site = "tool"']


def draw_arm(rng: np.random.Generator, size: float = 1.0) -> Arm:
    """An arm of 2 to 7 hinges with servos that are well damped; size: of its lengths beside those of a usual one."""
    n = int(rng.integers(2, 8))
    axes = ["z" if rng.random() < 0.5 else "y"] + [("y", "y", "z")[rng.integers(3)] for _ in range(n - 1)]
    if "y" not in axes:
        axes[-1] = "y"
    scale = np.linspace(1.0, 0.55, n)
    length = scale * rng.uniform(0.12, 0.3) * rng.uniform(0.8, 1.2, n) * size
    mass = scale**2 * rng.uniform(0.3, 1.5) * rng.uniform(0.7, 1.3, n) * size**3
    radius = 0.12 * length
    home = rng.uniform(-0.6, 0.6, n)
    kind = ("position", "position", "position", "velocity", "torque")[rng.integers(5)]
    bare = Arm(
        tuple(axes), length, mass, radius, np.full(n, 1e-6 * size**5), np.zeros(n), kind, np.ones(n), np.ones(n), home
    )
    inertia = inertia_at(bare, home)
    armature = inertia * rng.uniform(0.5, 2.0, n) + 0.002 * size**5
    inertia = inertia + armature
    damping = inertia * rng.uniform(0.5, 1.5, n)
    w = rng.uniform(9, 14) * (1.0 if kind == "torque" else size**-0.5)  # gravity bends them all alike
    if kind == "velocity":
        return Arm(tuple(axes), length, mass, radius, armature, damping, kind, np.zeros(n), inertia * w * 1.5, home)
    kp, kv = inertia * w**2, 2 * rng.uniform(0.8, 1.0) * inertia * w
    return Arm(tuple(axes), length, mass, radius, armature, damping, kind, kp, kv, home)


def inertia_at(arm: Arm, q: Array) -> Array:
    """Diagonal (n,) of the joint-space inertia at ``q``, kg m^2."""
    model = mujoco.MjModel.from_xml_string(mjcf(arm))
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return np.array(np.diag(full))


def mjcf(arm: Arm, actuators: bool = True) -> str:
    """The nominal model as MJCF text; without ``actuators`` for a truth that computes its own torques."""
    lines = [
        '<mujoco model="arm">',
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="{NOMINAL_STEP}" integrator="implicitfast"><flag contact="disable"/></option>',
        "  <worldbody>",
    ]
    indent = "    "
    for i, axis in enumerate(arm.axes):
        at = 0.0 if i == 0 else arm.length[i - 1]
        vector = {"y": "0 1 0", "z": "0 0 1"}[axis]
        lines += [
            f'{indent}<body name="link{i + 1}" pos="{at:.9g} 0 0">',
            f'{indent}  <joint name="j{i + 1}" type="hinge" axis="{vector}" '
            f'armature="{arm.armature[i]:.9g}" damping="{arm.damping[i]:.9g}"/>',
            f'{indent}  <geom type="capsule" fromto="0 0 0 {arm.length[i]:.9g} 0 0" '
            f'size="{arm.radius[i]:.9g}" mass="{arm.mass[i]:.9g}"/>',
        ]
        indent += "  "
    lines.append(f'{indent}<site name="tool" pos="{arm.length[-1]:.9g} 0 0"/>')
    for _ in arm.axes:
        indent = indent[:-2]
        lines.append(f"{indent}</body>")
    lines.append("  </worldbody>")
    if actuators:
        lines.append("  <actuator>")
        for i, joint in enumerate(arm.joints):
            if arm.kind == "position":
                gains = f'kp="{arm.kp[i]:.9g}" kv="{arm.kv[i]:.9g}"'
                lines.append(f'    <position name="{joint}" joint="{joint}" {gains}/>')
            elif arm.kind == "velocity":
                lines.append(f'    <velocity name="{joint}" joint="{joint}" kv="{arm.kv[i]:.9g}"/>')
            else:
                lines.append(f'    <motor name="{joint}" joint="{joint}" gear="1"/>')
        lines.append("  </actuator>")
    return "\n".join([*lines, "</mujoco>"]) + "\n"


def apart(truth: ArmTruth) -> list[int]:
    """The joints whose motor and link are no rigid whole."""
    return np.flatnonzero(np.isfinite(truth.stiffness) | (truth.play > 0)).tolist()


def gear_law(truth: ArmTruth, arm: Arm) -> GearLaw | None:
    """What lies between the motors and the links of the joints that are apart."""
    g = np.array(apart(truth), dtype=int)
    if not len(g):
        return None
    rotor = (arm.armature + truth.armature)[g]
    link = inertia_at(arm, arm.home)[g] - arm.armature[g]
    spring = (truth.stiffness[g], truth.wound[g], truth.ringing[g])
    return GearLaw(g, *spring, truth.play[g], rotor, link, arm.damping[g])


def compiled(truth: ArmTruth, arm: Arm) -> mujoco.MjModel:
    """The rigid bodies, masses changed, actuators taken out, at the fine step."""
    spec = mujoco.MjSpec.from_string(mjcf(arm, actuators=False))
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    for i, joint in enumerate(arm.joints):
        spec.joint(joint).armature = arm.armature[i] + truth.armature[i]
        if i in apart(truth):  # the rotor and what brakes it are computed elsewhere
            spec.joint(joint).armature, spec.joint(joint).damping[0] = 0.0, 0.0
        if truth.longer[i]:
            spec.body(f"link{i + 2}").pos = [arm.length[i] + truth.longer[i], 0, 0]
        body = spec.body(f"link{i + 1}")
        if truth.link_mass[i] or truth.link_com[i]:
            # the added mass is two lumps around the centre; moving the centre moves the whole capsule's mass
            centre = 0.5 * arm.length[i] + truth.link_com[i]
            body.geoms[0].fromto = [truth.link_com[i], 0, 0, arm.length[i] + truth.link_com[i], 0, 0]
            for side in (-0.02, 0.02):
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_SPHERE,
                    size=[0.01, 0, 0],
                    pos=[centre + side, 0, 0],
                    mass=0.5 * truth.link_mass[i],
                )
    if truth.payload:
        body = spec.body(f"link{len(arm.axes)}")
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.015, 0, 0],
            pos=[arm.length[-1] + truth.ahead, 0, 0],
            mass=truth.payload,
        )
    built_in(spec, truth.flaws, inertia_at(arm, arm.home))
    return spec.compile()
