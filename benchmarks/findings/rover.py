"""Finding 10: a rover on four wheels in contact with the ground, with 60 ms of delay and wheels 3 % small.

MuJoCo at 0.5 ms moves bodies and contacts; delay and the motors' law act outside the engine. At the model's 2 ms its
contacts turn the rover by up to 10 mrad a second otherwise, which is near the noise: a perfect one is no case.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.findings.motions import Array, Rng, drive
from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import Case, Truth, write_robot, write_run

SEED = 47000
STEP = 0.0005  # s
RADIUS = 0.06  # m
KV, FORCE = 1.5, 6.0  # N m s/rad, N m
RATE, COMMAND_RATE, SECONDS, TOP = 50.0, 25.0, 25.0, 8.0
NOISE = PoseNoise(0.001, 0.002)
CORNERS = {"fl": (0.13, 0.16), "fr": (0.13, -0.16), "rl": (-0.13, 0.16), "rr": (-0.13, -0.16)}  # m


@dataclass(frozen=True)
class Rover:
    """Its delay (s) and the scale of its wheels."""

    name: str
    delay: float
    scale: float


ROWS = (Rover("rover_delay_radius", 0.06, 0.97), Rover("rover_delay_radius_late", 0.12, 0.95))


def cases() -> list[Case]:
    """The rover with both effects, and one with more of them."""
    return [Case(row.name, 10, partial(make, row, SEED + k)) for k, row in enumerate(ROWS)]


def xml(scale: float = 1.0) -> str:
    """The MJCF; the hubs of smaller wheels sit lower in the chassis, which keeps its height."""
    radius = RADIUS * scale
    wheels = "\n".join(
        f'<body name="hub_{name}" pos="{x} {y} {radius - RADIUS - 0.02:.6f}">'
        f'<joint name="wheel_{name}" axis="0 1 0" armature="0.002" damping="0.01"/>'
        f'<geom type="ellipsoid" size="{radius:.6f} 0.02 {radius:.6f}" mass="0.3" friction="0.8 0.005 0.0001"/></body>'
        for name, (x, y) in CORNERS.items()
    )
    motors = "".join(
        f'<velocity name="{name}" joint="wheel_{name}" kv="{KV}" forcerange="{-FORCE} {FORCE}"/>' for name in CORNERS
    )
    return (
        '<mujoco model="rover4"><option timestep="0.002" integrator="implicitfast"/><worldbody>\n'
        '<geom type="plane" size="0 0 0.1" friction="0.8 0.005 0.0001"/>\n'
        f'<body name="chassis" pos="0 0 {RADIUS + 0.02}"><freejoint/>\n'
        '<geom type="box" size="0.18 0.12 0.03" mass="5" contype="0" conaffinity="0"/>\n'
        f"{wheels}\n</body></worldbody><actuator>{motors}</actuator></mujoco>\n"
    )


def make(row: Rover, seed: int, folder: Path, _: Path) -> None:
    """Write the model and three runs."""
    rng = np.random.default_rng(seed)
    write_robot(folder, ['name = "rover4"', 'plant = "mujoco"', 'model = "rover.xml"', 'pose_body = "chassis"'])
    (folder / "rover.xml").write_text(xml(), encoding="utf-8")
    for number, kind in enumerate(("steps", "multisine", "smooth"), start=1):
        sides = drive(rng, kind, SECONDS, COMMAND_RATE, TOP)
        write_run(folder, f"run{number}", logged(row, sides, rng))
    planted: dict[str, Any] = {"command_delay": {"delay": row.delay}, "wheel_radius": {"scale": row.scale}}
    said = "`unknown`, and then command delay closes 100 % of it"
    Truth("double", planted, encoders=True, said=said).write(folder)


def logged(row: Rover, sides: Array, rng: Rng) -> dict[str, Array]:
    """One run's table."""
    pose, speeds = moved(row, sides)
    ticks = np.arange(len(pose))
    sent = sides[(ticks * COMMAND_RATE / RATE + 1e-6).astype(int)]
    read = NOISE.added(rng, pose)
    columns = {"t": ticks / RATE}
    columns |= {f"command.{name}": sent[:, int(name[1] == "r")] for name in CORNERS}
    columns |= {f"pose.{name}": read[:, k] for k, name in enumerate(("x", "y", "theta"))}
    noisy = speeds + 0.02 * rng.standard_normal(speeds.shape)
    return columns | {f"velocity.wheel_{name}": noisy[:, k] for k, name in enumerate(CORNERS)}


def moved(row: Rover, sides: Array) -> tuple[Array, Array]:
    """Poses (samples, 3) and wheel speeds (samples, 4) at RATE; the robot comes to rest before the first command."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(xml(row.scale))
    model.opt.timestep = STEP
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data = mujoco.MjData(model)
    right = np.array([name[1] == "r" for name in CORNERS], dtype=int)
    u = np.repeat(sides[:, right], round(1 / COMMAND_RATE / STEP), axis=0)
    rest = np.zeros((round(1.0 / STEP), len(CORNERS)))
    u = np.concatenate([rest, np.zeros((round(row.delay / STEP), len(CORNERS))), u])[: len(u) + len(rest)]
    each, pose, speeds = round(1 / RATE / STEP), [], []
    for k, wanted in enumerate(u):
        if k >= len(rest) and (k - len(rest)) % each == 0:
            w, x, y, z = data.qpos[3:7]
            pose.append([data.qpos[0], data.qpos[1], np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))])
            speeds.append(data.qvel[6:].copy())
        data.qfrc_applied[6:] = np.clip(KV * (wanted - data.qvel[6:]), -FORCE, FORCE)
        mujoco.mj_step(model, data)
    flat = np.array(pose)
    return np.column_stack([flat[:, :2], np.unwrap(flat[:, 2])]), np.array(speeds)
