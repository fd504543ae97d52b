"""A motion is planned for what could not be told apart, driven by a robot of its own, and then it can."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.arms import MIXED, arm_xml
from oracles.rover_euler import simulate
from oracles.rover_log import ROBOT, SIGMA, write_run
from oracles.urdfs import arm_urdf

from residual_mpc.cli.main import main
from residual_mpc.logs.run import Run

PERIOD = 0.05  # s
ARM = 'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n'
LAG = {"actuator_lag": {"time_constant": 0.05}}


def driven(name: str, t: np.ndarray, u: np.ndarray, faults: Mapping[str, Mapping[str, float]], encoders: bool) -> Run:
    """What the literal rover logs under commands u (n, 2) at t (n,)."""

    def command(time: float) -> tuple[float, float]:
        k = int(np.clip(np.searchsorted(t, time + 1e-9) - 1, 0, len(t) - 1))
        return float(u[k, 0]), float(u[k, 1])

    rng = np.random.default_rng(5)
    pose = simulate(command, t, faults, fine=1e-3)
    columns = {"command.left": u[:, 0], "command.right": u[:, 1]}
    columns |= {c: pose[:, i] + s * rng.standard_normal(len(t)) for i, (c, s) in enumerate(SIGMA.items())}
    if encoders:
        gain = faults.get("actuator_gain", {}).get("gain", 1.0)
        columns |= {
            f"velocity.{w}": gain * u[:, i] + 0.02 * rng.standard_normal(len(t))
            for i, w in enumerate(("left", "right"))
        }
    return Run(name, t, columns)


def gently(t: np.ndarray) -> np.ndarray:
    """(n, 2): the same slow sine for both wheels, under which late is late, however it comes about."""
    return np.repeat(5.0 * np.sin(2 * np.pi * 0.15 * t)[:, None], 2, axis=1)


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    return int(end.value.code or 0)


def diagnosed(folder: Path, runs: list[Run], only: str) -> dict:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.toml").write_text(ROBOT)
    files = [write_run(r, folder) for r in runs]
    assert call("diagnose", "--robot", folder / "robot.toml", *files, "--out", folder / "out", "--only", only) == 0
    return json.loads((folder / "out" / "diagnosis.json").read_text())


def read_commands(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with path.open() as file:
        rows = list(csv.DictReader(file))
    t = np.array([float(r["t"]) for r in rows])
    return t, np.array([[float(r["command.left"]), float(r["command.right"])] for r in rows])


@pytest.fixture(scope="module")
def confounded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rover with a lag that was driven too gently."""
    folder = tmp_path_factory.mktemp("gentle")
    t = PERIOD * np.arange(401)
    document = diagnosed(folder, [driven("gentle", t, gently(t), LAG, False)], "actuator_lag,command_delay")
    assert len(document["confounded"]) == 1 and len(document["alternatives"]) == 1
    return folder


def test_the_motion_that_was_planned_parts_them(confounded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    diagnosis, plan = confounded / "out" / "diagnosis.json", confounded / "next.csv"
    assert call("excite", diagnosis, "--robot", confounded / "robot.toml", "--out", plan, "--json") == 0
    said = json.loads(capsys.readouterr().out)["excite"]
    assert set(said["parts"]) == {"actuator_lag", "command_delay"} and said["told_apart"]
    assert said["motions"][0]["ratio"] == max(m["ratio"] for m in said["motions"])
    t, u = read_commands(plan)
    assert np.abs(u).max() <= 5.0 and t[-1] == pytest.approx(20.0) and np.abs(u[[0, -1]]).max() < 1e-9
    again = diagnosed(confounded / "again", [driven("planned", t, u, LAG, False)], "actuator_lag,command_delay")
    assert [e["effect"] for e in again["explanation"]] == ["actuator_lag"] and not again["confounded"]
    assert again["explanation"][0]["parameters"]["time_constant"]["value"] == pytest.approx(0.05, abs=0.008)


def test_a_diagnosis_has_its_experiment_beside_it(confounded: Path, tmp_path: Path) -> None:
    document = json.loads((confounded / "out" / "diagnosis.json").read_text())
    experiment = document["next_experiment"]
    assert experiment["commands"] == "next.csv" and experiment["told_apart"]
    words = experiment["excite"].split()
    assert words[:2] == ["residual-mpc", "excite"] and words[-1] == str(confounded / "out" / "next.csv")
    again = tmp_path / "again.csv"
    assert call(*words[1:-1], again) == 0
    assert again.read_text() == (confounded / "out" / "next.csv").read_text()


def test_a_gap_that_nothing_explains_is_looked_at_twice_and_elsewhere(
    confounded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads((confounded / "out" / "diagnosis.json").read_text())
    content |= {"verdict": "unknown", "alternatives": []}
    (tmp_path / "diagnosis.json").write_text(json.dumps(content))
    plan = tmp_path / "next.csv"
    words = ("excite", tmp_path / "diagnosis.json", "--robot", confounded / "robot.toml", "--out", plan)
    assert call(*words, "--json") == 0
    said = json.loads(capsys.readouterr().out)["excite"]
    assert said["purpose"] == "explore" and len(said["motions"]) == 3
    first, second, third = said["motions"]
    assert second["name"] == first["name"] + " again" and third["name"] != first["name"]
    assert "turning left" in third["unseen"]  # both wheels were always driven alike
    with plan.open() as file:
        rows = list(csv.DictReader(file))
    driven_as = {run: [r["command.left"] for r in rows if r["run"] == run] for run in {r["run"] for r in rows}}
    name = first["name"].replace(" ", "_")
    assert len(driven_as) == 3 and driven_as[name] == driven_as[name + "_again"]
    assert call(*words) == 0
    assert "run the motion that shows it most, twice" in capsys.readouterr().out


@pytest.mark.slow
def test_a_sensor_is_asked_for_where_no_motion_will_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = PERIOD * np.arange(401)
    weak = {"actuator_gain": {"gain": 1.1}}
    diagnosed(tmp_path, [driven("gentle", t, gently(t), weak, False)], "actuator_gain,wheel_radius")
    plan = tmp_path / "next.csv"
    capsys.readouterr()
    assert (
        call("excite", tmp_path / "out" / "diagnosis.json", "--robot", tmp_path / "robot.toml", "--out", plan, "--json")
        == 0
    )
    said = json.loads(capsys.readouterr().out)["excite"]
    assert said["sensors"] == ["velocity.left", "velocity.right"] and said["told_apart"]
    u = read_commands(plan)
    again = diagnosed(tmp_path / "again", [driven("planned", *u, weak, True)], "actuator_gain,wheel_radius")
    assert [e["effect"] for e in again["explanation"]] == ["actuator_gain"] and not again["confounded"]


def test_a_first_protocol_stays_within_the_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "arm.xml").write_text(
        arm_xml().replace('name="j1" axis="0 1 0"', 'name="j1" axis="0 1 0" range="-60 30"')
    )
    (tmp_path / "robot.toml").write_text(ARM)
    out = tmp_path / "first.csv"
    assert call("excite", "--robot", tmp_path / "robot.toml", "--out", out, "--seconds", 6) == 0
    said = capsys.readouterr()
    assert "5 motions" in said.out and "leave its range" not in said.err
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert {r["run"] for r in rows} == {"slow_sweeps", "chirp", "steps", "multisine", "held_steps"}
    first = np.degrees([float(r["command.j1"]) for r in rows]) / 2.0  # gear 2
    assert -60.0 <= first.min() < -20.0 and 0.0 < first.max() <= 30.0


def test_the_commands_keep_to_the_speed_limits_of_a_urdf(tmp_path: Path) -> None:
    """A servo follows a step as fast as its motor can, whatever the model says of its gains."""
    (tmp_path / "arm.urdf").write_text(arm_urdf(("j1", "j2"), -2.0, 2.0).replace('velocity="9"', 'velocity="1.5"', 1))
    servos = "".join(f'[actuator.{j}]\nkind = "position"\nkp = 80.0\nkv = 4.0\n' for j in ("j1", "j2"))
    (tmp_path / "robot.toml").write_text(f'name = "arm"\nplant = "mujoco"\nmodel = "arm.urdf"\n{servos}')
    out = tmp_path / "first.csv"
    assert call("excite", "--robot", tmp_path / "robot.toml", "--out", out, "--seconds", 6) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    t = np.array([float(r["t"]) for r in rows])
    same = np.diff(t) > 0.0
    fastest, last = {}, np.flatnonzero(np.diff(t, append=-1.0) < 0.0)  # rows at which a motion ends
    for joint in ("j1", "j2"):
        sent = np.array([float(r[f"command.{joint}"]) for r in rows])
        assert sent[last] == pytest.approx(0.0, abs=1e-9)  # at home, where the next one begins
        fastest[joint] = float(np.abs(np.diff(sent)[same] / np.diff(t)[same]).max())
    assert fastest["j1"] == pytest.approx(0.7 * 1.5, rel=1e-3) and fastest["j2"] == pytest.approx(0.7 * 9.0, rel=1e-3)


def test_a_motion_that_no_size_makes_safe_is_marked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A joint that no servo holds falls out of its range, whatever is commanded."""
    xml = arm_xml(MIXED).replace('name="j1" axis="0 1 0"', 'name="j1" axis="0 1 0" range="-10 10"')
    (tmp_path / "arm.xml").write_text(xml)
    (tmp_path / "robot.toml").write_text(ARM)
    words = ("excite", "--robot", tmp_path / "robot.toml", "--out", tmp_path / "first.csv", "--seconds", 4, "--json")
    assert call(*words, "--limit", "j1=-0.1:0.1", "--limit", "j2=-0.1:0.1") == 0
    said = capsys.readouterr()
    motions = json.loads(said.out)["excite"]["motions"]
    assert len(motions) == 5 and not any(m["within_limits"] for m in motions)
    assert said.err.count("a joint is predicted to leave its range") == 5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "no command limits are known for left, right"),
        (("--limit", "left=-1:1", "--limit", "arm=0:1"), "unknown actuator 'arm'"),
        (("--limit", "left=-1:1"), "no command limits are known for right"),
        (("--limit", "left=1:-1"), "the lower limit must be below"),
        (("--limit", "left=-1:1", "--limit", "right=-inf:inf"), "right must be two finite numbers"),
        (("--limit", "left=-1:1", "--limit", "right=-1:1", "--limit", "arm=0:1"), "unknown actuator 'arm'"),
        (("--limit", "left"), "must be ACTUATOR=LOW:HIGH"),
    ],
)
def test_what_cannot_be_planned(
    arguments: tuple, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    assert call("excite", "--robot", tmp_path / "robot.toml", "--out", tmp_path / "x.csv", *arguments) == 2
    assert words in capsys.readouterr().err and not (tmp_path / "x.csv").exists()


def test_a_diagnosis_of_another_robot_is_refused(
    confounded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(arm_xml())
    (tmp_path / "robot.toml").write_text(ARM)
    diagnosis = confounded / "out" / "diagnosis.json"
    assert call("excite", diagnosis, "--robot", tmp_path / "robot.toml", "--out", tmp_path / "x.csv") == 2
    assert "its commands are not those of this robot" in capsys.readouterr().err


def spoilt(content: dict[str, Any]) -> None:
    content["alternatives"][0]["values"][0]["value"] = None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.update(d.pop("model")), "schema must be 'residual-mpc/diagnosis/1', got 'residual-mpc/model/1'"),
        (lambda d: d.update(schema="somebody/diagnosis/7"), "got 'somebody/diagnosis/7'"),
        (lambda d: d.pop("schema"), "got None"),
        (lambda d: d.pop("setup"), "does not record how its runs were driven"),
        (lambda d: d["setup"].pop("period"), "how the runs were driven cannot be read"),
        (lambda d: d.update(setup=7), "how the runs were driven cannot be read"),
        (lambda d: d["setup"]["commands"].pop("left"), "its commands are not those of this robot"),
        (lambda d: d.update(robot="digger"), "must be of 'rover', got one of 'digger'"),
        (lambda d: d.pop("explanation"), "its explanations cannot be read"),
        (lambda d: d.pop("model"), "its explanations cannot be read"),
        (lambda d: d.update(alternatives=[7]), "its explanations cannot be read"),
        (spoilt, "its explanations cannot be read"),
        (lambda d: d["model"]["values"][0].update(value=float("nan")), "its explanations cannot be read"),
        (lambda d: d["model"]["values"][0].update(target="third"), " on third"),
        (lambda d: d["alternatives"][0]["values"][0].update(effect="warp"), "the effect 'warp' is not installed"),
    ],
)
def test_a_diagnosis_that_cannot_be_read_is_refused(
    change: Callable[[dict[str, Any]], object],
    words: str,
    confounded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    content = json.loads((confounded / "out" / "diagnosis.json").read_text())
    change(content)
    (tmp_path / "diagnosis.json").write_text(json.dumps(content))
    words_given = ("--robot", confounded / "robot.toml", "--out", tmp_path / "x.csv")
    assert call("excite", tmp_path / "diagnosis.json", *words_given) == 2
    said = capsys.readouterr().err
    assert words in said and str(tmp_path / "diagnosis.json") in said and len(said.splitlines()) == 1
    assert not (tmp_path / "x.csv").exists()
