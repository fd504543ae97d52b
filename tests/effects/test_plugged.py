"""An effect of a user's own: one file and an entry point, and it is diagnosed like any other."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run
from short_films import PROGRAM

from residual_mpc.effects.contract import EffectBroken, check_effect
from residual_mpc.effects.effect import Effect, Parameter
from residual_mpc.effects.library import BUILT_IN
from residual_mpc.effects.plugged import TARGETS

OWN = '''
"""Encoders of the motor controllers wrap commands into steps of this size."""
from residual_mpc.effects.effect import Effect, Parameter, no_memory

def squashed(ops, p, memory, u, dt):
    return u / (1.0 + p["softness"] * ops.absolute(u)), memory

SOFT = Effect(
    name="soft_command", stage="command", port="command", target="actuator",
    parameters=(Parameter("softness", "1/command unit", 0.0, 0.0, 10.0, (0.02, 0.1, 0.3)),),
    summary="large commands do less and less", start=no_memory, step=squashed,
)
DRAG = Effect(
    name="air_drag", stage="body", port="friction", target="joint",
    parameters=(Parameter("coefficient", "N m s2/rad2", 0.0, 0.0, 10.0, (0.05, 0.3)),),
    summary="air resists, with the square of the speed", step=lambda ops, p, w, tau: p["coefficient"] * w * w,
)
'''


def install(
    folder: Path, code: str = OWN, points: str = "soft = own_effects:SOFT\ndrag = own_effects:DRAG\n"
) -> dict[str, str]:
    """A package beside the interpreter's own, without installing anything; the environment that sees it."""
    (folder / "own_effects.py").write_text(code)
    info = folder / "own_effects-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-effects\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[residual_mpc.effects]\n{points}")
    return {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}


def call(
    environment: dict[str, str], *arguments: object, program: tuple[str, ...] = ("-m", "residual_mpc.cli.main")
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *program, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_it_is_named_with_its_number(tmp_path: Path) -> None:
    environment = install(tmp_path)
    run = rover_run("one", {}, 16.0, seed=2)
    columns = dict(run.columns)
    for wheel in ("left", "right"):  # the log says what was sent; the robot did this of it
        u = columns[f"command.{wheel}"]
        columns[f"command.{wheel}"] = u / (1.0 - 0.05 * np.abs(u))
    logs = tmp_path / "logs"
    logs.mkdir()
    (logs / "robot.toml").write_text(ROBOT)
    file = write_run(replace(run, columns=columns), logs)
    arguments = ("--robot", logs / "robot.toml", file, "--out", logs / "out")
    only = ("--only", "soft_command,actuator_gain,track_width,actuator_lag")
    done = call(environment, "diagnose", *arguments, *only, program=("-c", PROGRAM))
    assert done.returncode == 0, done.stderr
    document = json.loads((logs / "out" / "diagnosis.json").read_text())
    (cause,) = document["explanation"]
    assert (cause["effect"], cause["target"]) == ("soft_command", None)
    assert cause["parameters"]["softness"]["value"] == pytest.approx(0.05, rel=0.15)
    assert (
        "soft_command" in (logs / "out" / "report.html").read_text() or "soft command" in document["verdict_sentence"]
    )
    model = call(environment, "export", logs / "out" / "model.json", "--to", "casadi", "--out", logs / "casadi")
    assert model.returncode == 0 and "left out" not in model.stderr
    program = """
import residual_mpc as rm, sys
robot = rm.load_robot(sys.argv[1] + "/robot.toml")
model = rm.augment(robot, sys.argv[1] + "/out/model.json", dt=0.05)
f, names = model.casadi(), model.parameters
at = [n for n in names if n.startswith("soft_command")]
assert len(at) == 2 and set(at) == {"soft_command.left.softness", "soft_command.right.softness"}, names
u = [4.0, 4.0]
there = f(model.x0, u, model.p)
without = [0.0 if n in at else v for n, v in zip(names, model.p)]
free = f(model.x0, u, without)
softness = model.p[names.index(at[0])]
assert abs(float(there[0]) / float(free[0]) - 1.0 / (1.0 + 4.0 * softness)) < 1e-9  # slower by what the effect says
mpc = model.mpc(horizon=5)
"""
    used = subprocess.run([sys.executable, "-c", program, str(logs)], env=environment, capture_output=True, text=True)
    assert used.returncode == 0, used.stderr


def test_a_friction_of_ones_own_brakes_a_joint(tmp_path: Path) -> None:
    environment = install(tmp_path)
    program = """
import numpy as np
from oracles.arms import arm_xml, random_drive, random_start, robot_of, settings_of
from pathlib import Path
from residual_mpc.effects.contract import check_effect
from residual_mpc.effects.library import PLUGGED
assert [e.name for e in PLUGGED] == ["air_drag", "soft_command"]
for e in PLUGGED: check_effect(e, np.random.default_rng(0))
import sys
robot = robot_of(Path(sys.argv[1]), arm_xml())
assert robot.slots("air_drag") == ("j1", "j2") and robot.slots("soft_command") == ("j1", "j2")
drive, start = random_drive(robot, 2, 300), random_start(robot, 2)
settings = settings_of(robot, {}, {("air_drag", None, "coefficient"): 3.0})
braked = robot.replay(start, drive, settings, ("velocity.j1",))["velocity.j1"]
free = robot.replay(start, drive, settings_of(robot, {}, {}), ("velocity.j1",))["velocity.j1"]
assert np.array_equal(braked[0], free[0]) and np.abs(braked[1]).mean() < 0.8 * np.abs(free[1]).mean()
"""
    environment["PYTHONPATH"] += os.pathsep + str(Path(__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("code", "points", "words"),
    [
        ("raise OSError('gone')", "soft = own_effects:SOFT", "cannot be imported"),
        ("SOFT = 3", "soft = own_effects:SOFT", "must be an Effect, got int"),
        (OWN.replace('"soft_command"', '"saturation"'), "soft = own_effects:SOFT", "named 'saturation' exists already"),
        (OWN.replace('port="command"', 'port="ground"'), "soft = own_effects:SOFT", "got 'ground' on 'actuator'"),
    ],
)
def test_what_cannot_be_plugged_in_is_refused(tmp_path: Path, code: str, points: str, words: str) -> None:
    environment = install(tmp_path, code, points)
    (tmp_path / "robot.toml").write_text(ROBOT)
    done = call(environment, "gap", "--robot", tmp_path / "robot.toml", write_run(rover_run("one", {}, 3.0), tmp_path))
    assert done.returncode == 2 and words in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "effect", [e for e in BUILT_IN if TARGETS.get(e.port) == e.target and e.step], ids=lambda e: e.name
)
def test_the_librarys_own_keep_the_contract(effect: Effect) -> None:
    check_effect(effect, np.random.default_rng(0))


def _bad(step: object, **change: object) -> Effect:
    soft = Parameter("softness", "1", 0.0, 0.0, 10.0, (0.1,))
    whole = Effect("bad", "command", "command", "actuator", (soft,), "", lambda ops, p, u, dt: (), step)  # type: ignore[arg-type]
    return replace(whole, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (_bad(lambda ops, p, m, u, dt: (u + 1e-12, m)), "at its null value it changes a signal"),
        (_bad(lambda ops, p, m, u, dt: (u, m)), "it changes nothing"),
        (_bad(lambda ops, p, m, u, dt: (u + ops.where(p["softness"] > 0, np.inf, 0.0), m)), "it gives"),
        (
            _bad(lambda ops, p, m, u, dt: (u - p["softness"] * np.searchsorted([-1.0, 1.0], u), m)),
            "does not run in CasADi",
        ),
        (_bad(lambda ops, p, m, u, dt: (u, m), parameters=()), "it has no parameter"),
        (
            _bad(
                lambda ops, p, m, u, dt: (u - p["softness"] * m, u),
                start=lambda ops, p, u, dt: u,
                rounded=lambda ops, p, u, width: u,
            ),
            "`rounded` equation, which takes no memory",
        ),
    ],
)
def test_what_breaks_the_contract_is_said(effect: Effect, words: str) -> None:
    with pytest.raises(EffectBroken, match=words):
        check_effect(effect, np.random.default_rng(0))
