"""Findings 7 and 8 on recorded robots: two double pendulums with known errors put into model or log, and the SO-101."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.findings.records import Case, Truth, write_robot

THREE = ("link_length", "coulomb_friction", "armature")
BIAS = 0.1  # rad
TIP = 0.15  # kg
# From an independent fit of the same runs (shared/data/README.md): dry friction (N m), rotor (kg m^2), torque.
KNOWN: dict[str, dict[str, Any]] = {
    "a": {
        "coulomb_friction": [{"target": "shoulder", "torque": 0.145}, {"target": "elbow", "torque": 0.112}],
        "armature": [{"target": "shoulder", "inertia": 0.005}, {"target": "elbow", "inertia": 0.005}],
        "actuator_gain": [{"target": "m1", "gain": 0.98}, {"target": "m2", "gain": 0.92}],
    },
    "c": {
        "coulomb_friction": [{"target": "shoulder", "torque": 0.136}, {"target": "elbow", "torque": 0.091}],
        "armature": [{"target": "shoulder", "inertia": 0.0019}, {"target": "elbow", "inertia": 0.0027}],
        "actuator_gain": [{"target": "m1", "gain": 1.03}, {"target": "m2", "gain": 0.84}],
    },
}
Edit = Callable[[str], str]


@dataclass(frozen=True)
class Pendulum:
    """One diagnosis of a build: candidates (none: the whole library), an edit of the model, a bias of the log."""

    name: str
    build: str
    said: str
    only: tuple[str, ...] = THREE
    edit: Edit = str
    bias: float = 0.0  # rad
    planted: Mapping[str, Any] = field(default_factory=dict)


def replaced(pattern: str, text: str, model: str) -> str:
    """The model with the one place that matches `pattern` replaced."""
    edited, count = re.subn(pattern, text, model)
    if count != 1:
        raise ValueError(f"{pattern} is in the model {count} times, wanted once")
    return edited


def longer(model: str) -> str:
    """The upper link 5 cm too long: the elbow sits farther out; the upper link's centre of mass stays where it is."""
    return replaced(r'name="lower" pos="0 0 -0.2"', 'name="lower" pos="0 0 -0.25"', model)


def lighter(model: str) -> str:
    """The lower link of build c without 0.15 kg at its tip: mass, centre and inertia follow from a point mass there."""
    mass, centre, inertia, tip = 0.625568, 0.255693, 0.009971, 0.3
    left = mass - TIP
    new = (mass * centre - TIP * tip) / left
    about = inertia + mass * centre**2 - TIP * tip**2 - left * new**2
    inertial = f'<inertial pos="0 0 {-new:.6f}" mass="{left:.6f}" diaginertia="{about:.6f} {about:.6f} 0.0005"/>'
    return replaced(r'<inertial pos="0 0 -0.255693"[^>]*/>', inertial, model)


def weaker(model: str) -> str:
    """The elbow's motor at 0.7 of its torque: the robot then gives 1 / 0.7 of what the model expects."""
    return replaced(r'name="m2" joint="elbow"', 'name="m2" joint="elbow" gear="0.7"', model)


ROWS = (
    Pendulum("a_three", "a", "friction 0.138, gap 0.429 to 0.077"),
    Pendulum("c_three", "c", "friction 0.344 and rotor 0.0093 of the elbow alone, gap 0.526 to 0.349"),
    Pendulum("c_long_upper", "c", "friction and inertia of the elbow, no link_length", edit=longer,
             planted={"link_length": {"target": "upper", "offset": -0.05}}),
    Pendulum("c_tip_missing", "c", "payload not named", (*THREE, "payload"), lighter,
             planted={"payload": {"mass": TIP}}),
    Pendulum("c_elbow_bias", "c", "bias not named", (*THREE, "sensor_bias"), bias=BIAS,
             planted={"sensor_bias": {"target": "position.elbow", "bias": BIAS}}),
    Pendulum("c_elbow_gain", "c", "viscous_friction and armature at 0.97",
             (*THREE, "actuator_gain", "viscous_friction"), weaker,
             planted={"actuator_gain": [{"target": "m1", "gain": 1.03}, {"target": "m2", "gain": 0.84 / 0.7}]}),
    Pendulum("c_whole_library", "c", "coulomb_friction 0.164 on both joints, gap 0.131", ()),
)  # fmt: skip

SO101 = (
    "actuator_bandwidth", "trapezoidal_profile", "hold_under_gravity", "staircase_motion", "sinusoidal_sweep",
    "fast_transitions", "wave_motion", "reach_and_return", "slow_precision", "circular_motion",
)  # fmt: skip


def cases() -> list[Case]:
    """The pendulums, then the SO-101 from ten motions, judged on all others."""
    pendulums = [
        Case(f"pendulum_{row.name}", 7, partial(make_pendulum, row),
             options=tuple(word for effect in row.only for word in ("--only", effect)), data=f"pendulum/{row.build}")
        for row in ROWS
    ]  # fmt: skip
    return [*pendulums, Case("so101_ten_motions", 8, make_so101, data="so101", motions=SO101, judged=True)]


def make_pendulum(row: Pendulum, folder: Path, data: Path) -> None:
    """Write the edited model and, with a bias, the edited runs; the others are read where they lie."""
    source = data / "pendulum" / row.build
    model = f"pendulum_{row.build}.xml"
    (folder / model).write_text(row.edit((source / model).read_text(encoding="utf-8")), encoding="utf-8")
    write_robot(folder, ['name = "pendulum"', 'plant = "mujoco"', f'model = "{model}"', 'payload_site = "tip"'])
    if row.bias:
        write_biased(source, folder, row.bias)
    friction = {"coulomb_friction": KNOWN[row.build]["coulomb_friction"]}
    background = {name: entry for name, entry in KNOWN[row.build].items() if name not in {*friction, *row.planted}}
    Truth("recorded", {**friction, **row.planted}, background, encoders=True, said=row.said, within=1.5).write(folder)


def write_biased(source: Path, folder: Path, bias: float) -> None:
    """The runs with a constant added to the elbow's position."""
    import pandas as pd

    for path in sorted(source.glob("*.parquet")):
        table = pd.read_parquet(path)
        table["position.elbow"] += bias
        table.to_parquet(folder / f"run_{path.name}")


def make_so101(folder: Path, data: Path) -> None:
    """Copy the robot; an independent set of effects closes 67 % of the gap on motions that it has not seen."""
    for name in ("robot.toml", "so101.xml"):
        (folder / name).write_text((data / "so101" / name).read_text(encoding="utf-8"), encoding="utf-8")
    Truth("recorded", encoders=True, said="dead_zone 0.0084 at 0.17; 6 % closed", closes=0.6).write(folder)
