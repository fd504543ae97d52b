"""`residual-mpc batch`: a fleet of rovers, one of which cannot be read."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from oracles.rover_log import ROBOT, rover_run, write_run
from short_films import PROGRAM

from residual_mpc.batch.jobs import Job, jobs_in
from residual_mpc.batch.run import BatchSettings, _state, run_batch
from residual_mpc.cli.main import main
from residual_mpc.errors import BadInput
from residual_mpc.processes.engine import Engine

ONLY = "--only track_width,wheel_radius"


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(["batch", *arguments])
    assert isinstance(end.value.code, int)
    return end.value.code


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """rover.toml; a and b with two runs each, b with a tenth more track; own with a model of its own that has it."""
    (tmp_path / "rover.toml").write_text(ROBOT)
    for name, scale in (("a", 1.0), ("b", 1.1), ("own", 1.1)):
        (tmp_path / name).mkdir()
        for k in range(2):
            write_run(rover_run(f"r{k}", {"track_width": {"scale": scale}}, 8.0, seed=k), tmp_path / name)
    (tmp_path / "own" / "robot.toml").write_text(ROBOT.replace("0.16", "0.176"))
    monkeypatch.chdir(tmp_path)
    yield tmp_path


def test_each_robot_is_diagnosed_by_itself_and_a_bad_one_fails_alone(
    fleet: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    short = [sys.executable, "-c", PROGRAM, "diagnose"]  # with short films, which take most of the time
    monkeypatch.setattr("residual_mpc.batch.run.program", lambda *_: short)
    (fleet / "torn").mkdir()
    (fleet / "torn" / "r0.csv").write_text("t,nothing\n")
    arguments = ("a", "b", "own", "torn", "--robot", "rover.toml", "--out", "out", "--options", ONLY, "--jobs", "1")
    assert call(*arguments) == 2
    printed = capsys.readouterr()
    assert printed.out.splitlines()[0].split()[:2] == ["b", "effects"]  # the largest gap first
    assert "track_width" in printed.out and "torn  failed" in printed.err
    page = (fleet / "out" / "index.html").read_text()
    assert all(f'href="{name}/report.html"' in page for name in ("a", "b", "own"))
    assert not (fleet / "out" / "torn").exists()
    assert call(*arguments, "--json") == 2
    results = {r["name"]: r for r in json.loads(capsys.readouterr().out)["batch"]["results"]}
    assert [results[n]["verdict"] for n in ("a", "b", "own", "torn")] == ["no_gap", "effects", "no_gap", None]
    assert {n: r["resumed"] for n, r in results.items()} == {"a": True, "b": True, "own": True, "torn": False}


@pytest.mark.slow
def test_what_has_changed_is_diagnosed_again(fleet: Path) -> None:
    jobs, settings = (
        jobs_in([fleet / "a", fleet / "b"], "rover.toml", fleet / "out"),
        BatchSettings(ONLY, engine=Engine(jobs=1)),
    )
    first = run_batch(jobs, fleet / "out", settings)
    assert [o.resumed for o in first] == [False, False]
    write_run(rover_run("r2", {}, 8.0, seed=2), fleet / "a")
    assert [o.resumed for o in run_batch(jobs, fleet / "out", settings)] == [False, True]
    (fleet / "b" / "r0.csv").write_text("t,nothing\n")
    failed = run_batch(jobs, fleet / "out", settings)[1]
    assert failed.status == "failed" and not (fleet / "out" / "b").exists()  # nothing of the runs before is left
    write_run(rover_run("r0", {"track_width": {"scale": 1.1}}, 8.0), fleet / "b")
    other = BatchSettings(ONLY, seed=1, engine=Engine(jobs=1))
    assert [o.resumed for o in run_batch(jobs[1:], fleet / "out", other)] == [False]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("a",), "no robot.toml in it"),
        (("a", "nowhere", "--robot", "rover.toml"), "must be a folder with the runs of one robot"),
        (("a", "--robot", "rover.toml", "--out", "a/results"), "must not contain each other"),
        (("a", "sub/a", "--robot", "rover.toml"), "two folders are called 'a'"),
        (("a", "--robot", "rover.toml", "--options", "--out x"), "cannot be handed"),
        (("a", "--robot", "rover.toml", "--timeout", "0"), "must be > 0"),
        (("a", "--robot", "rover.toml", "--engine", "cloud"), "unknown engine 'cloud'"),
        (("a", "--robot", "rover.toml", "--jobs", "0"), "must be -1 or a number"),
        (("a", "--robot", "rover.toml", "--address", "host:8786"), "is of a Dask scheduler"),
        (("a", "--robot", "rover.toml", "--options", "--without 'x"), "No closing quotation"),
        (("a", "--robot", "rover.toml", "--options", "--help"), "cannot be handed"),
    ],
)
def test_what_cannot_be_done_is_said_before_anything_is_written(
    fleet: Path, arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (fleet / "sub" / "a").mkdir(parents=True)
    assert call("--out", "out", *arguments) == 2
    error = capsys.readouterr().err
    assert says in error and "Traceback" not in error
    assert not (fleet / "out").exists() and not (fleet / "a" / "results").exists()


def test_a_job_knows_the_files_that_its_model_is_made_of(fleet: Path) -> None:
    """An edited mesh, or a file that an option names, makes another answer; so does another robot."""
    (fleet / "arm").mkdir()
    for name in ("arm.xml", "link.stl", "arm.toml"):
        (fleet / "arm" / name).write_text('<mujoco model="arm"/>' if name != "arm.toml" else 'plant = "mujoco"\n')
    (fleet / "arm" / "arm.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    (job,) = jobs_in([fleet / "a"], "arm/arm.toml", fleet / "out")
    (fleet / "earlier.json").write_text("{}")
    first = job.inputs(["--from", "earlier.json"])
    assert {Path(p).name for p in first} == {"r0.csv", "r1.csv", "arm.toml", "arm.xml", "link.stl", "earlier.json"}
    (fleet / "arm" / "link.stl").write_text("longer")
    assert job.inputs(["--from", "earlier.json"]) != first


def test_another_built_in_robot_is_another_answer(fleet: Path) -> None:
    one, other = (Job("a", robot, fleet / "a") for robot in ("rover", "diff_drive"))
    assert _state(one, ["diagnose"]) == _state(one, ["diagnose"]) != _state(other, ["diagnose"])


def test_what_goes_wrong_in_one_job_is_its_own(fleet: Path) -> None:
    (fleet / "out").mkdir()
    (fleet / "out" / "a").write_text("no folder")
    jobs = jobs_in([fleet / "a", fleet / "b"], "rover.toml", fleet / "out")
    outcomes = run_batch(jobs, fleet / "out", BatchSettings(ONLY, engine=Engine(jobs=1)))
    assert [o.status for o in outcomes] == ["failed", "done"] and "a" in outcomes[0].complaint


def test_a_robot_that_takes_too_long_is_stopped(fleet: Path) -> None:
    jobs = jobs_in([fleet / "b"], "rover.toml", fleet / "out")
    (outcome,) = run_batch(jobs, fleet / "out", BatchSettings(timeout=0.2, engine=Engine(jobs=1)))
    assert outcome.status == "over 0.2 s" and not outcome.done


def test_dask_spreads_as_processes_do(fleet: Path) -> None:
    pytest.importorskip("dask.distributed")
    jobs = jobs_in([fleet / "a"], "rover.toml", fleet / "out")
    (outcome,) = run_batch(jobs, fleet / "out", BatchSettings(ONLY, engine=Engine("dask", 1)))
    assert outcome.verdict == "no_gap"


def test_an_engine_nobody_knows() -> None:
    with pytest.raises(BadInput, match="Known engines: processes, dask"):
        Engine("cloud")
