"""Findings 2, 4 and 5 on arms: a spring beside a joint, a payload on a heavy arm, a delay with friction and payload."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.findings.arm_models import HEAVY, SEVEN, SIX, ArmModel
from benchmarks.findings.arms import Arm, Controller, Logging, follow, table, torque_control
from benchmarks.findings.motions import Array, setpoints
from benchmarks.findings.records import Case, Truth, write_robot, write_run

SEED = 45000
SECONDS = 20.0
EPOCH = 1_760_000_000  # s
SIX_CENTRE, SIX_REACH = (0.0, -1.2, 1.5, -1.0, 0.3, 0.0), (0.8, 0.4, 0.5, 0.6, 0.6, 0.8)
HEAVY_CENTRE, HEAVY_REACH = (0.0, 0.4, 0.5, 0.0, 0.4, 0.0), (0.6, 0.3, 0.4, 0.6, 0.5, 0.8)
SEVEN_CENTRE, SEVEN_REACH = (0.0, 0.3, 0.0, 0.9, 0.0, 0.8, 0.0), (0.6, 0.4, 0.6, 0.5, 0.7, 0.5, 0.8)
HEAVY_KP, HEAVY_KV = np.array([400.0, 400, 300, 40, 40, 15]), np.array([60.0, 60, 40, 5, 5, 2])
FOURTH = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
SPRING, REST = 60.0, 0.5  # N m/rad, rad


@dataclass(frozen=True)
class ArmCase:
    """A robot: its nominal model, what it is in truth, how it is driven and logged."""

    name: str
    finding: int
    model: ArmModel
    arm: Arm
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    truth: Truth
    control: Callable[[Array], Controller] = follow
    log: Logging = Logging()


SPRUNG = Arm(
    SEVEN.xml(), SEVEN.servos, stiffness=[SPRING * f for f in FOURTH], rest=[REST * f for f in FOURTH]
)  # fmt: skip
AT_FOURTH = {"target": "j4", "stiffness": SPRING, "rest": REST}
SAID_OF_SPRING = '`effects`: actuator_gain 0.44 at 0.97, "Explained", at 32 times the floor'
LATE_ARM = Truth(
    "triple",
    {"command_delay": {"delay": 0.04}, "coulomb_friction": {"target": "j3", "torque": 12.0}, "payload": {"mass": 0.5}},
    encoders=True, within=1.25, said="delay and friction right, payload 0.36 kg, where the search began, at 0.19",
)  # fmt: skip
ROWS = (
    ArmCase(
        "arm7_spring", 2, SEVEN, SPRUNG, SEVEN_CENTRE, SEVEN_REACH,
        Truth("spring", {"joint_spring": AT_FOURTH}, encoders=True, lacking=True, said=SAID_OF_SPRING),
    ),
    ArmCase(
        "arm7_cable", 2, SEVEN, replace(SPRUNG, one_sided=True), SEVEN_CENTRE, SEVEN_REACH,
        Truth("changed", {"x_cable": AT_FOURTH}, {"joint_spring": AT_FOURTH}, encoders=True, said="not tried"),
    ),
    *(
        ArmCase(
            name, 5, SIX, Arm(SIX.xml(0.5), SIX.servos, delay=0.04, friction=(0.0, 0.0, 12.0, 0.0, 0.0, 0.0)),
            SIX_CENTRE, SIX_REACH, LATE_ARM, log=log,
        )
        for name, log in (
            ("arm6_delay_friction_payload", Logging(epoch=EPOCH)),
            ("arm6_delay_friction_payload_ns", Logging(epoch=EPOCH, nanoseconds=True)),
        )
    ),
    ArmCase(
        "arm6_heavy_payload", 4, HEAVY, Arm(HEAVY.xml(0.6), HEAVY.servos), HEAVY_CENTRE, HEAVY_REACH,
        Truth("single", {"payload": {"mass": 0.6}}, encoders=True, within=1.25,
              said="armature of 5.5 kg m^2 on every joint"),
        control=partial(torque_control, HEAVY.xml(), kp=HEAVY_KP, kv=HEAVY_KV), log=Logging(rate=200.0),
    ),
)  # fmt: skip


def cases() -> list[Case]:
    """One case a row."""
    return [Case(row.name, row.finding, partial(make, row, SEED + k)) for k, row in enumerate(ROWS)]


def make(row: ArmCase, seed: int, folder: Path, _: Path) -> None:
    """Write the model, three runs and the truth."""
    rng = np.random.default_rng(seed)
    write_robot(
        folder, [f'name = "{row.model.name}"', 'plant = "mujoco"', 'model = "arm.xml"', 'payload_site = "tool"']
    )
    (folder / "arm.xml").write_text(row.model.xml(), encoding="utf-8")
    for number in range(1, 4):
        wanted = setpoints(rng, SECONDS, row.log.rate, row.centre, row.reach)
        columns = table(row.arm, row.control(wanted), wanted[0], SECONDS, row.log, rng)
        write_run(folder, f"run{number}", columns)
    row.truth.write(folder)
