"""Without any extra: a robot is loaded, checked, measured and diagnosed; what needs more says how to install it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import DT, arm_xml, wheel_xml
from oracles.rover_log import ROBOT, rover_run, write_run
from oracles.urdfs import arm_urdf
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from residual_mpc.logs.run import Run

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PROGRAM = """
import importlib.abc, sys

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""
COMMAND = "from residual_mpc.cli.main import main\nmain(sys.argv[1:])\n"


def needed(requirements: Iterable[str]) -> set[str]:
    """The distributions that these requirements install, with what they need in turn."""
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name not in found and (requirement.marker is None or requirement.marker.evaluate({"extra": ""})):
            found.add(name)
            waiting += [Requirement(text) for text in metadata.requires(name) or ()]
    return found


def absent() -> tuple[str, ...]:
    """Every module of this environment that the base install does not bring."""
    base = needed(PROJECT["dependencies"]) | {"residual-mpc", "coverage"}  # coverage measures these very programs
    brought = metadata.packages_distributions()
    return tuple(sorted(m for m, by in brought.items() if not base & {canonicalize_name(d) for d in by}))


ABSENT = absent()


def base(program: str, *arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    """A program in an interpreter that finds nothing but what the base install brings."""
    words = [sys.executable, "-c", PROGRAM.format(absent=ABSENT) + program, *map(str, arguments)]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)


def command(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    return base(COMMAND, *arguments, folder=folder)


DIAGNOSE = """
import json
import residual_mpc as rm
robot = rm.load_robot(sys.argv[1])
runs = rm.read_runs(robot, sys.argv[2])
found = rm.diagnose(robot, runs, only=tuple(sys.argv[3:]))
print(json.dumps({
    "usable": rm.check(robot, runs).usable,
    "gap": rm.measure_gap(robot, runs).nominal,
    "verdict": found.verdict,
    "effects": [e["effect"] for e in found.explanation],
}))
"""


EFFECTS = ("actuator_gain", "coulomb_friction")


def diagnosed(folder: Path, robot: str, *only: str) -> dict[str, object]:
    ended = base(DIAGNOSE, robot, "runs", *only, folder=folder)
    assert ended.returncode == 0, ended.stderr
    said: dict[str, object] = json.loads(ended.stdout)
    return said


def logged(model: mujoco.MjModel, folder: Path, names: tuple[str, ...], strength: float, size: float) -> None:
    """Two runs of six seconds in which every motor gives `strength` times the torque that was sent."""
    (folder / "runs").mkdir()
    every, n = round(0.01 / DT), 600
    for seed in range(2):
        rng, data = np.random.default_rng(seed), mujoco.MjData(model)
        t = 0.01 * np.arange(n)
        frequency, phase = rng.uniform(0.4, 1.5, (2, 3, len(names)))
        u = size * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1)
        q = np.empty((n, len(names)))
        for k in range(n):
            q[k] = data.qpos
            data.qfrc_applied[:] = strength * u[k]
            for _ in range(every):
                mujoco.mj_step(model, data)
        q += 1e-4 * rng.standard_normal(q.shape)
        columns = {f"command.{a}": u[:, i] for i, a in enumerate(names)}
        columns |= {f"position.{a}": q[:, i] for i, a in enumerate(names)}
        write_run(Run(f"r{seed}", t, columns), folder / "runs")


def test_an_mjcf_never_seen_is_diagnosed(tmp_path: Path) -> None:
    (tmp_path / "wheel.xml").write_text(wheel_xml())
    logged(mujoco.MjModel.from_xml_string(wheel_xml()), tmp_path, ("hub",), 1.3, 0.1)
    said = diagnosed(tmp_path, "wheel.xml", *EFFECTS)
    assert said["usable"] and said["gap"] > 0.1  # type: ignore[operator]
    assert (said["verdict"], said["effects"]) == ("effects", ["actuator_gain"])


def test_a_urdf_never_seen_is_diagnosed(tmp_path: Path) -> None:
    urdf = arm_urdf(("j1", "j2"), -3, 3)
    (tmp_path / "arm.urdf").write_text(urdf)
    motors = "".join(f'[actuator.{j}]\nkind = "motor"\n' for j in ("j1", "j2"))
    (tmp_path / "robot.toml").write_text(f'name = "arm"\nplant = "mujoco"\nmodel = "arm.urdf"\n{motors}')
    model = mujoco.MjModel.from_xml_string(urdf)
    model.opt.timestep, model.opt.integrator = DT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    logged(model, tmp_path, ("j1", "j2"), 1.3, 0.5)
    said = diagnosed(tmp_path, "robot.toml", "actuator_gain")
    assert said["usable"] and said["gap"] > 0.02  # type: ignore[operator]
    assert (said["verdict"], said["effects"]) == ("effects", ["actuator_gain"])


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rover.toml, runs/, out/ with a diagnosis and learned/ with a network, all by commands of the base install."""
    folder = tmp_path_factory.mktemp("rover")
    (folder / "rover.toml").write_text(ROBOT)
    (folder / "runs").mkdir()
    for k in range(2):
        write_run(rover_run(f"r{k}", {"track_width": {"scale": 1.2}}, 12.0, seed=k), folder / "runs")
    for words in (
        ("check",),
        ("gap",),
        ("diagnose", "--only", "track_width", "--out", "out"),
        ("learn", "--hidden", "2", "--passes", "1", "--out", "learned"),
    ):
        ended = command(*words, "--robot", "rover.toml", "runs", folder=folder)
        assert ended.returncode == 0, ended.stderr
    return folder


def test_the_commands_diagnose_and_learn_a_built_in_robot(rover: Path) -> None:
    document = json.loads((rover / "out" / "diagnosis.json").read_text())
    assert [e["effect"] for e in document["explanation"]] == ["track_width"]
    assert (rover / "out" / "report.html").is_file() and (rover / "learned" / "model.json").is_file()


@pytest.mark.parametrize(
    ("to", "package", "extra"), [("casadi", "casadi", "mpc"), ("c", "casadi", "mpc"), ("jax", "jax", "jax")]
)
def test_an_export_that_needs_more_says_how_to_install_it(rover: Path, to: str, package: str, extra: str) -> None:
    ended = command("export", "out/diagnosis.json", "--to", to, "--out", f"export_{to}", folder=rover)
    said = f"the package {package} is not installed. Install it with `pip install 'residual-mpc[{extra}]'`."
    assert (ended.returncode, ended.stderr.splitlines()) == (2, [f"residual-mpc: {said}"])
    assert not any((rover / f"export_{to}").iterdir())


@pytest.mark.parametrize(("to", "package"), [("rerun", "rerun"), ("mcap", "mcap")])
def test_a_recording_to_be_written_that_needs_more_says_how_to_install_it(rover: Path, to: str, package: str) -> None:
    ended = command("export", "out/diagnosis.json", "--to", to, "--out", f"recorded_{to}", folder=rover)
    said = f"the package {package} is not installed. Install it with `pip install 'residual-mpc[{to}]'`."
    assert (ended.returncode, ended.stderr.splitlines()) == (2, [f"residual-mpc: {said}"])
    assert not (rover / f"recorded_{to}").exists()


AUGMENT = """
import numpy as np
import residual_mpc as rm
model = rm.augment(rm.load_robot("rover.toml"), "out/diagnosis.json")
print(model)
print(model.step(model.x0, np.array([3.0, 2.0])))
for build in (model.mpc, lambda: model.lqr(np.zeros((40, 3))), lambda: model.linearize(model.x0, np.zeros(2))):
    try:
        build()
    except rm.BadInput as fault:
        print(fault.remedy)
"""


def test_an_augmented_model_steps_and_its_controllers_say_what_they_need(rover: Path) -> None:
    ended = base(AUGMENT, folder=rover)
    assert ended.returncode == 0, ended.stderr
    assert "command.left, command.right" in ended.stdout
    assert ended.stdout.count("install it with `pip install 'residual-mpc[mpc]'`") == 3


OWN_ARM = """
import residual_mpc as rm

model = rm.augment(rm.load_robot("own.xml"))
print(model)
try:
    model.x0
except rm.BadInput as fault:
    print(fault.remedy)
"""


def test_the_step_of_ones_own_arm_says_what_it_needs(tmp_path: Path) -> None:
    (tmp_path / "own.xml").write_text(arm_xml())
    ended = base(OWN_ARM, folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert "install it with `pip install 'residual-mpc[arm]'`" in ended.stdout


def test_the_base_install_brings_nothing_that_an_extra_is_for() -> None:
    assert {"casadi", "osqp", "daqp", "control", "jax", "onnx", "pybullet", "pytest"} <= set(ABSENT)
    assert not {"numpy", "scipy", "pandas", "mujoco", "matplotlib", "residual_mpc"} & set(ABSENT)


def test_every_extra_that_a_message_names_is_there() -> None:
    """In all packages that are installed."""
    named = {
        name
        for package in ("residual_mpc", "controllers", "plants", "scenarios")
        for path in (ROOT / package).rglob("*.py")
        for name in re.findall(r"""with extra\("(\w+)"\)""", path.read_text())
    }
    assert named == {"mpc", "arm", "jax", "onnx", "dask", "warp", "pybullet", "rosbag", "mcap", "hdf5", "rerun"}
    assert named <= set(PROJECT["optional-dependencies"])


@pytest.mark.parametrize(
    ("name", "content", "package", "extra"),
    [
        ("run.mcap", b"\x89MCAP0\r\n" + bytes(60), "mcap", "mcap"),
        ("run.db3", b"SQLite format 3\x00" + bytes(60), "rosbags", "rosbag"),
        ("run.h5", b"\x89HDF\r\n\x1a\n" + bytes(60), "h5py", "hdf5"),
    ],
)
def test_a_recording_that_needs_more_says_how_to_install_it(
    tmp_path: Path, name: str, content: bytes, package: str, extra: str
) -> None:
    (tmp_path / "rover.toml").write_text(ROBOT)
    (tmp_path / name).write_bytes(content)
    ended = command("gap", "--robot", "rover.toml", name, folder=tmp_path)
    assert ended.returncode == 2
    assert f"the package {package}" in ended.stderr and f"pip install 'residual-mpc[{extra}]'" in ended.stderr


def test_archives_that_need_no_more_are_read(tmp_path: Path) -> None:
    (tmp_path / "rover.toml").write_text(ROBOT)
    run = rover_run("drive", {}, 5.0)
    np.savez(tmp_path / "run.npz", t=run.t, **run.columns)
    ended = command("gap", "--robot", "rover.toml", "run.npz", folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
