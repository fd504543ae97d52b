"""`import residual_mpc as rm`: every function gives what its command gives."""

from __future__ import annotations

import html
import json
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run

import residual_mpc as rm
from residual_mpc.cli.main import main

FAULTS = {"actuator_lag": {"time_constant": 0.12}, "track_width": {"scale": 1.12}}
LEARN = ["--hidden", "4", "--passes", "1"]
ONLY = ("actuator_lag", "command_delay", "actuator_gain", "track_width")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """rover.toml and runs/ of a lagging rover."""
    place = tmp_path_factory.mktemp("rover")
    (place / "rover.toml").write_text(ROBOT)
    (place / "runs").mkdir()
    for k in range(3):
        write_run(rover_run(f"r{k}", FAULTS, seconds=12.0, seed=k), place / "runs")
    return place


@pytest.fixture(scope="module")
def robot(folder: Path) -> rm.NominalRobot:
    return rm.load_robot(folder / "rover.toml")


@pytest.fixture(scope="module")
def runs(folder: Path, robot: rm.NominalRobot) -> rm.Runs:
    return rm.read_runs(robot, folder / "runs")


@pytest.fixture(scope="module")
def diagnosis(folder: Path, robot: rm.NominalRobot, runs: rm.Runs) -> rm.Diagnosis:
    found = rm.diagnose(robot, runs, seed=3, only=ONLY)
    found.save(folder / "by_api")
    return found


@pytest.fixture(scope="module")
def learned(robot: rm.NominalRobot, runs: rm.Runs, diagnosis: rm.Diagnosis) -> rm.LearnedModel:
    return rm.learn(robot, runs, on=diagnosis, hidden=(4,), passes=1)


def said(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    """What a command prints with --json."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        main([*map(str, words), "--json"])
    assert end.value.code == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def call(folder: Path, command: str) -> tuple[object, ...]:
    return command, "--robot", folder / "rover.toml", folder / "runs"


def test_check_and_gap(
    folder: Path, robot: rm.NominalRobot, runs: rm.Runs, diagnosis: rm.Diagnosis, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rm.check(robot, runs).document == said(capsys, *call(folder, "check"))
    assert rm.check(robot, folder / "runs").document == rm.check(robot, runs).document
    assert rm.measure_gap(robot, runs).document == said(capsys, *call(folder, "gap"))
    file = folder / "by_api" / "diagnosis.json"
    options = ("--model", file, "--held-out-of", file)
    beside = rm.measure_gap(robot, runs, model=diagnosis, held_out_of=diagnosis)
    assert beside.document == said(capsys, *call(folder, "gap"), *options)
    assert beside.model == pytest.approx(diagnosis.gap["after"], rel=0.05)


def test_diagnose(folder: Path, diagnosis: rm.Diagnosis, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "by_command"
    printed = said(capsys, *call(folder, "diagnose"), "--out", out, "--seed", 3, "--only", ",".join(ONLY))
    mine = diagnosis.document_in(out)
    assert {k: v for k, v in printed.items() if k != "command"} == {k: v for k, v in mine.items() if k != "command"}
    assert sorted(p.name for p in out.iterdir()) == sorted(p.name for p in (folder / "by_api").iterdir())
    assert diagnosis.verdict == "effects"
    assert {e["effect"] for e in diagnosis.explanation} == set(FAULTS)


@pytest.mark.slow
def test_the_command_in_a_report_does_the_same(
    folder: Path, diagnosis: rm.Diagnosis, capsys: pytest.CaptureFixture[str]
) -> None:
    import shlex

    words = shlex.split(diagnosis.document["command"])
    words[words.index("--out") + 1] = str(folder / "again")
    printed = said(capsys, *words[1:])
    assert printed["explanation"] == diagnosis.explanation


def test_learn(
    folder: Path, robot: rm.NominalRobot, learned: rm.LearnedModel, capsys: pytest.CaptureFixture[str]
) -> None:
    on = folder / "by_api" / "diagnosis.json"
    printed = said(capsys, *call(folder, "learn"), "--on", on, *LEARN, "--out", folder / "learned")
    timed = ("seconds", "update_ms")
    assert {k: v for k, v in printed.items() if k not in timed} == {
        k: v for k, v in learned.document.items() if k not in timed
    }


def test_excite(folder: Path, robot: rm.NominalRobot, capsys: pytest.CaptureFixture[str]) -> None:
    file = folder / "next.csv"
    limits = ("--limit", "left=-5:5", "--limit", "right=-5:5")
    printed = said(capsys, "excite", "--robot", folder / "rover.toml", "--out", file, "--seconds", 6, *limits)["excite"]
    plan = rm.excite(robot, seconds=6.0, limits={"left": (-5.0, 5.0), "right": (-5.0, 5.0)})
    assert {**plan.document, "file": str(file)} == printed
    assert plan.table == file.read_text() and "command.left" in plan.to_frame()


def test_export(
    folder: Path,
    robot: rm.NominalRobot,
    diagnosis: rm.Diagnosis,
    learned: rm.LearnedModel,
    capsys: pytest.CaptureFixture[str],
) -> None:
    learned.save(folder / "model")
    printed = said(capsys, "export", folder / "model" / "model.json", "--to", "casadi", "--out", folder / "casadi")
    model = rm.augment(robot, diagnosis, learned)
    assert model.export("casadi", folder / "casadi") == printed
    assert model.dt == learned.document["step"]


def test_the_augmented_model_steps_and_linearises(robot: rm.NominalRobot, diagnosis: rm.Diagnosis) -> None:
    model = rm.augment(robot, diagnosis, dt=0.05)
    x, u = model.x0, np.array([3.0, 2.0])
    f = model.casadi()
    assert np.array(f(x, u, model.p)).ravel() == pytest.approx(model.step(x, u))
    a, b = model.linearize(x, u)
    assert a.shape == (len(x), len(x)) and b.shape == (len(x), 2)
    nudge = 1e-6
    assert (model.step(x, u + [nudge, 0.0]) - model.step(x, u)) / nudge == pytest.approx(b[:, 0], abs=1e-5)


def test_controllers_are_one_call(robot: rm.NominalRobot, diagnosis: rm.Diagnosis) -> None:
    model = rm.augment(robot, diagnosis, dt=0.05)
    t = 0.05 * np.arange(60)
    path = np.column_stack([0.2 * t, 0.0 * t, 0.0 * t])  # m, m, rad
    mpc = model.mpc(horizon=15)
    state, x = mpc.init(), model.x0
    for k in range(40):
        command, state, info = mpc.step(state, x, path[k + 1 : k + 16])
        x = model.step(x, command)
        assert info.outcome == "solved"
    assert x[model.states.index("pose.x")] == pytest.approx(path[40, 0], abs=0.02)
    lqr = model.lqr(path)
    command, _, _ = lqr.step(lqr.init(), model.x0, path[:1])
    assert command.shape == (2,) and command.min() > 0.0


def test_a_network_on_other_effects_is_refused(robot: rm.NominalRobot, runs: rm.Runs, diagnosis: rm.Diagnosis) -> None:
    alone = rm.learn(robot, runs, hidden=(3,), passes=1)
    with pytest.raises(rm.BadInput, match="other effects"):
        rm.augment(robot, diagnosis, alone)
    assert rm.augment(robot, None, alone).dt == alone.document["step"]


def test_results_show_themselves(
    robot: rm.NominalRobot, runs: rm.Runs, diagnosis: rm.Diagnosis, learned: rm.LearnedModel
) -> None:
    shown = [robot, runs, rm.check(robot, runs), rm.measure_gap(robot, runs), diagnosis, learned, rm.augment(robot)]
    for result in shown:
        text, page = str(result), result._repr_html_()
        assert text and page.startswith("<pre>") and html.escape(text.splitlines()[0]) in page
        line = repr(result)
        assert line.startswith(f"<{type(result).__name__}: ") and "\n" not in line and len(line) < 400, line
    controllers = rm.augment(robot).mpc(), rm.augment(robot).lqr(np.zeros((5, 3)))
    assert str(controllers[0]) == (
        "<Mpc of rover: 20 steps of 0.05 s, tracks pose.x, pose.y, pose.theta, commands left, right>"
    )
    assert str(controllers[1]) == "<Lqr of rover: along a path of 0.25 s>"
    frame = diagnosis.to_frame()
    assert set(frame["effect"]) == set(FAULTS) and (frame["low"] < frame["high"]).all()
    assert len(runs.to_frame()) == sum(len(r.t) for r in runs)
    assert {"horizon", "channel", "nominal"} <= set(rm.measure_gap(robot, runs).to_frame().columns)


def test_checks_and_gaps_are_saved_as_the_commands_print_them(
    tmp_path: Path, robot: rm.NominalRobot, runs: rm.Runs
) -> None:
    for found in (rm.check(robot, runs), rm.measure_gap(robot, runs)):
        file = found.save(tmp_path / "new" / "result.json")
        assert json.loads(file.read_text()) == found.document
        assert [p.name for p in file.parent.iterdir()] == ["result.json"]


def test_every_result_has_a_table_and_a_file(
    tmp_path: Path, robot: rm.NominalRobot, runs: rm.Runs, diagnosis: rm.Diagnosis, learned: rm.LearnedModel
) -> None:
    plan = rm.excite(robot, seconds=4.0, limits={"left": (-5.0, 5.0), "right": (-5.0, 5.0)})
    model = rm.augment(robot, diagnosis, learned)
    results = [runs, rm.check(robot, runs), rm.measure_gap(robot, runs), diagnosis, learned, plan, model]
    for result in results:
        place = tmp_path / type(result).__name__
        assert result.save(place) == place and place.exists()
        assert len(result.to_frame().columns) >= 2 and str(result) and result._repr_html_().startswith("<pre>")
    public = {name for name in rm.__all__ if name[0].isupper()}
    assert {type(r).__name__ for r in results} == public - {
        "BadInput", "Comparison", "Confirmation", "NominalRobot",  # have tests of their own
    }  # fmt: skip


def test_a_saved_model_is_the_same_model(
    tmp_path: Path, robot: rm.NominalRobot, runs: rm.Runs, diagnosis: rm.Diagnosis, learned: rm.LearnedModel
) -> None:
    model = rm.augment(robot, diagnosis, learned)
    file = model.save(tmp_path) / "model.json"
    again = rm.augment(robot, None, file)
    np.testing.assert_array_equal(again.p, model.p)
    assert again.dt == model.dt and again.parameters == model.parameters
    whole = rm.augment(robot, file)  # a file with a network is used whole
    assert whole.parameters == model.parameters
    bare = rm.augment(robot, diagnosis)
    assert "residual" not in json.loads((bare.save(tmp_path / "bare") / "model.json").read_text())
    assert rm.measure_gap(robot, runs, model=model).model == rm.measure_gap(robot, runs, model=learned).model
    values = {(r.effect, r.parameter): r.value for r in model.to_frame().itertuples()}
    assert {effect for effect, _ in values} == set(FAULTS)
    assert values["track_width", "scale"] == pytest.approx(1.12, abs=0.02)


def test_names_of_commands_need_no_compiler(robot: rm.NominalRobot) -> None:
    model = rm.augment(robot)
    assert model.commands == ("command.left", "command.right")
    assert not {"augmented", "_compiled"} & set(vars(model))
    assert model.commands == model._compiled.u_names


def test_runs_are_saved_as_a_table_that_is_read_back(
    tmp_path: Path, robot: rm.NominalRobot, runs: rm.Runs
) -> None:
    again = rm.read_runs(robot, runs.save(tmp_path / "runs.csv"))
    assert again.to_frame().drop(columns="run").equals(runs.to_frame().drop(columns="run"))
    assert [name.rpartition("/")[2] for name in again.names] == list(runs.names)


def test_checks_and_reading_tell_the_variants_of_a_robot_apart(folder: Path) -> None:
    """Variants that differ in a parameter alone have models of their own; equal ones share one."""
    wide = '[[variant]]\nruns = "r0"\nparameters = { track_width = 0.3 }\n'
    file = folder / "variants.toml"
    file.write_text(ROBOT + wide)
    robot = rm.load_robot(file)
    models = rm.read_runs(robot, folder / "runs").models
    assert [m.nominal()["track_width"] for m in models] == [0.3, 0.16, 0.16]
    assert models[1] is models[2] is robot.model
    file.write_text(ROBOT + wide.replace("0.3", "-0.3"))
    (fault,) = rm.check(rm.load_robot(file), folder / "runs").errors
    assert fault.run == "r0" and "track_width" in fault.message


def test_faults_are_those_of_the_commands(folder: Path, robot: rm.NominalRobot, runs: rm.Runs) -> None:
    with pytest.raises(rm.BadInput, match="unknown effect 'lag'"):
        rm.diagnose(robot, runs, only=("lag",))
    with pytest.raises(rm.BadInput, match="no run matches 'r9'"):
        rm.diagnose(robot, runs, held_out=("r9",))
    with pytest.raises(rm.BadInput):
        rm.load_robot(folder / "nothing.toml")


def test_every_public_name_is_there_and_importing_is_quick() -> None:
    assert all(getattr(rm, name) is not None for name in rm.__all__)
    assert sorted(rm.__all__) == sorted(dir(rm))
    slow = ("numpy", "importlib.metadata")
    program = (
        f"import sys, residual_mpc; print([name for name in {slow!r} if name in sys.modules], residual_mpc.__version__)"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["[]", version("residual-mpc")]
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        rm.nothing  # noqa: B018
