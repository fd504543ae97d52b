"""A case as a user would have it: a robot file, its MJCF, and runs in the project's log format."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.head_to_head.servo import (
    CASES,
    FRESH,
    KP,
    LINK_COM,
    LINK_INERTIA,
    LINK_MASS,
    MOTIONS,
    TOOL,
    TUNED,
    Log,
    Servo,
    draw,
    guess,
    record,
)

JOINT = "shoulder"
TIMESTEP = 0.002  # s, of the model: MuJoCo's default
# At this step RK4 errs less than the encoder; the first-order scheme errs more, which is a gap of its own
INTEGRATOR = {case: "implicitfast" if case == "step" else "RK4" for case in CASES}
FIELD = {"armature": "armature", "damping": "damping", "friction": "frictionloss"}  # ours -> MuJoCo's
HIDDEN = {"delay": ("command_delay", "delay"), "payload": ("payload", "mass")}  # ours -> (effect, parameter)

MJCF = """\
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="{timestep}" integrator="{integrator}"/>
  <worldbody>
    <body name="arm">
      <joint name="{joint}" type="hinge" axis="0 1 0"
             armature="{armature!r}" damping="{damping!r}" frictionloss="{friction!r}"/>
      <inertial pos="0 0 {com}" mass="{mass}" diaginertia="{inertia} {inertia} 2e-5"/>
      <site name="tool" pos="0 0 {tool}"/>
    </body>
  </worldbody>
  <actuator>
    <position name="{joint}" joint="{joint}" kp="{kp}"/>
  </actuator>
</mujoco>
"""

ROBOT = """\
name = "servo"
plant = "mujoco"
model = "servo.xml"
payload_site = "tool"
tunable = ["joint.*.armature", "joint.*.damping", "joint.*.frictionloss"]
"""


def write_case(case: str, seed: int, folder: Path) -> tuple[Servo, Servo]:
    """Write the model, `runs/` for the tools and `fresh/` for the judge into a folder.

    Returns the truth, which is in none of the files, and the guess that the model holds.
    """
    rng = np.random.default_rng([list(CASES).index(case), seed])
    servo = draw(case, rng)
    given = guess(servo, rng)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.toml").write_text(ROBOT)
    (folder / "servo.xml").write_text(mjcf(given, INTEGRATOR[case]))
    write_runs([record(servo, m, m, rng) for m in MOTIONS], folder / "runs")
    write_runs([record(servo, m, f"fresh_{m}", rng) for m in FRESH], folder / "fresh")
    return servo, given


def mjcf(servo: Servo, integrator: str) -> str:
    """The model with these parameters; what is hidden is not in it."""
    known = {"com": -LINK_COM, "mass": LINK_MASS, "inertia": LINK_INERTIA, "tool": -TOOL, "kp": KP}
    guessed = {name: float(getattr(servo, name)) for name in TUNED}
    return MJCF.format(joint=JOINT, timestep=TIMESTEP, integrator=integrator, **known, **guessed)


def write_runs(logs: Sequence[Log], folder: Path) -> None:
    """One CSV a run."""
    folder.mkdir(parents=True, exist_ok=True)
    for log in logs:
        with (folder / f"{log.name}.csv").open("w", newline="") as file:
            out = csv.writer(file)
            out.writerow(["t", f"command.{JOINT}", f"position.{JOINT}"])
            out.writerows(np.column_stack([log.t, log.command, log.position]).tolist())


def read_runs(folder: Path) -> list[Log]:
    """The runs of a folder by name: both tools read the same files."""
    found = []
    for path in sorted(folder.glob("*.csv")):
        t, u, q = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
        found.append(Log(path.stem, t, u, q))
    return found


def write_model(values: Mapping[str, float], path: Path) -> Path:
    """A model.json that `residual-mpc gap --model` takes, from values by our names."""
    entries = []
    for name, value in values.items():
        effect, parameter = HIDDEN.get(name) or ("tune", f"joint.{JOINT}.{FIELD[name]}")
        entries.append({"effect": effect, "target": None, "parameter": parameter, "value": value})
    model = {"schema": "residual-mpc/model/1", "robot": "servo", "values": entries, "leaves_out_outliers": False}
    path.write_text(json.dumps(model, indent=2) + "\n")
    return path
