"""Experiments on sealed cases, with stubs in place of planner, diagnosis and robot."""

import json
import shlex
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from answers import answer
from click.testing import CliRunner
from test_sweep import CANARY, STUB, small_case, stub

from residual_mpc.blind import experiment as experiment_module
from residual_mpc.blind import make as make_module
from residual_mpc.blind.commanded_motion import read_commanded_motions
from residual_mpc.blind.experiment import ExperimentSettings, run_experiments
from residual_mpc.blind.make import MakeSettings, make_suite
from residual_mpc.blind.records import Answer
from residual_mpc.blind.run import RunSettings, run_suite
from residual_mpc.blind.score.resolved import score_experiments
from residual_mpc.cli.blind import blind
from residual_mpc.errors import BadInput

PLANNER = shlex.join([sys.executable, str(STUB.with_name("stub_planner.py"))])


@dataclass(frozen=True)
class StubTwin:
    answer: Answer
    safe: bool = True

    def play(self, asked, rng, name, folder):
        if self.safe:
            (folder / f"{name}.csv").write_text(f"t,{','.join(asked.sensors)}\n0,{rng.random()}\n")
        return self.safe


def stub_twin(family, level, seed, folder):
    return StubTwin(small_case(family, level, seed, Path(folder)))


def settings(*told: str, jobs: int = 1) -> ExperimentSettings:
    return ExperimentSettings(stub(*told), PLANNER, jobs, 60.0)


def experiments(place: Path, *told: str):
    return run_experiments(
        place / "suite", place / "answers", place / "results", place / "out", settings(*told), lambda text, done: None
    )


@pytest.fixture
def suite(tmp_path, monkeypatch):
    monkeypatch.setattr(make_module, "make_case", small_case)
    monkeypatch.setattr(experiment_module, "make_hidden_robot", stub_twin)
    make_suite(MakeSettings(("wheeled",), ("single",), cases=2, jobs=1), tmp_path / "suite", tmp_path / "answers")
    run_suite(tmp_path / "suite", tmp_path / "results", RunSettings(stub("unknown"), jobs=1))
    return tmp_path


def records(place: Path) -> list[dict]:
    return [json.loads(p.read_text()) for p in sorted((place / "out").glob("*/experiment.json"))]


def test_nothing_of_an_answer_reaches_who_plans_or_who_diagnoses(suite, monkeypatch):
    monkeypatch.setenv("SECRET_OF_THE_CALLER", CANARY)
    summary = experiments(suite, "effects", "slope", "-")
    assert (summary.cases, summary.open, summary.failed) == (2, 2, 0)
    for name in ("case-0001", "case-0002"):
        record = json.loads((suite / "out" / name / "experiment.json").read_text())
        again = json.loads((suite / "out" / name / "again" / "diagnosis.json").read_text())
        for seen in (record["plan"]["seen"], again["seen"]):
            assert "robot.toml" in seen  # the stub did look
            assert CANARY not in seen and "answers" not in seen and name not in seen and "single" not in seen
        assert "next1.csv" in again["seen"] and "velocity.left" in again["seen"]
        assert record["runs"] == ["next1.csv"] and (suite / "out" / name / "next1.csv").exists()


def test_experiments_resume(suite):
    experiments(suite, "effects", "slope", "-")
    (suite / "out" / "case-0002" / "experiment.json").unlink()
    assert experiments(suite, "effects", "slope", "-").resumed == 1


def test_a_diagnosis_that_leaves_nothing_open_needs_no_experiment(suite):
    path = suite / "results" / "case-0001" / "diagnosis.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "verdict": "no_gap"}))
    assert experiments(suite, "effects", "slope", "-").open == 1
    assert not (suite / "out" / "case-0001" / "again").exists()


def test_a_robot_that_is_not_the_one_that_was_sealed_is_refused(suite, monkeypatch):
    def other(family, level, seed, to):
        return stub_twin(family, level, seed + 1, to)

    monkeypatch.setattr(experiment_module, "make_hidden_robot", other)
    assert experiments(suite, "effects").failed == 2
    assert all("draws a different robot" in r["status"] for r in records(suite))


def test_failing_experiments_fail_alone(suite, monkeypatch):
    monkeypatch.setattr(
        experiment_module, "make_hidden_robot", lambda *case: StubTwin(stub_twin(*case).answer, safe=case[2] != 0)
    )
    assert experiments(suite, "effects", "slope", "-").failed == 1
    assert sum("diverges" in r["status"] for r in records(suite)) == 1
    for record in (suite / "out").glob("*/experiment.json"):
        record.unlink()
    assert experiments(suite, "crash").failed == 2


def test_the_command_line_carries_out_and_scores(suite):
    place = {k: str(suite / k) for k in ("suite", "answers", "results", "out", "page")}
    call = ["experiment", place["suite"], "--results", place["results"], "--answers", place["answers"]]
    call += ["--out", place["out"], "--command", stub("effects", "slope", "-"), "--planner", PLANNER]
    call += ["--jobs", "1", "--json"]
    done = CliRunner().invoke(blind, call)
    assert done.exit_code == 0 and json.loads(done.stdout)["experiment"]["open"] == 2, done.output
    call = ["score", place["suite"], "--results", place["results"], "--answers", place["answers"], "--experiments",
            place["out"], "--out", place["page"], "--json"]  # fmt: skip
    done = CliRunner().invoke(blind, call)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)["score"]["experiments"]
    assert found["groups"]["count"] == 0
    assert (found["right_before"]["value"], found["right_after"]["value"]) == (0.0, 1.0)
    assert "Results of the proposed experiments" in (suite / "page" / "blind.html").read_text()


RADIUS, GAIN, LAG = (("wheel_radius", None), ("actuator_gain", None), ("actuator_lag", None))


def written(folder: Path, named, groups=(), close=(), verdict="effects") -> None:
    def part(name):
        return {"effect": name[0], "target": name[1]}

    document = {
        "verdict": verdict,
        "explanation": [part(n) for n in named],
        "confounded": [[part(m) for m in g] for g in groups],
        "alternatives": [{"instead_of": [part(a)], "effects": [part(b)], "confounded": False} for a, b in close],
    }
    folder.mkdir(parents=True)
    (folder / "diagnosis.json").write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("named", "groups", "outcome"),
    [
        ([RADIUS], [], "resolved"),
        ([RADIUS], [[RADIUS, LAG]], "resolved"),  # without the wrong member
        ([GAIN], [[RADIUS, GAIN]], "stayed"),
        ([RADIUS], [[RADIUS, GAIN]], "stayed"),
        ([GAIN], [], "became wrong"),
        (None, [], "failed"),
    ],
)
def test_what_becomes_of_a_group(named, groups, outcome, tmp_path):
    """A wheel's radius that looked like weak motors, with a lag as a close rival."""
    written(tmp_path / "first" / "x", [GAIN], [[GAIN, RADIUS]], [(GAIN, LAG)])
    if named is not None:
        written(tmp_path / "out" / "x" / "again", named, groups)
    (tmp_path / "out" / "x").mkdir(parents=True, exist_ok=True)
    (tmp_path / "out" / "x" / "experiment.json").write_text(json.dumps({"status": "done" if named else "over 1 s"}))
    found = score_experiments({"x": answer(RADIUS)}, tmp_path / "first", tmp_path / "out")
    group, rival = found.questions
    assert group.confounded and group.outcome == outcome and not rival.confounded
    assert found.groups.hits == (outcome == "resolved") and found.groups.count == 1
    assert found.groups_holding == found.groups and found.rivals_holding.count == 0  # a lag stood for weak motors
    assert found.right_before.hits == 1 and found.right_after.hits == (outcome in ("resolved", "stayed"))


def test_a_group_that_holds_no_cause_is_counted_apart(tmp_path):
    """No experiment can show which of two is there where neither is."""
    written(tmp_path / "first" / "x", [GAIN], [[GAIN, RADIUS]], verdict="partial")
    written(tmp_path / "out" / "x" / "again", [GAIN], verdict="partial")
    (tmp_path / "out" / "x" / "experiment.json").write_text(json.dumps({"status": "done"}))
    hidden = replace(answer(LAG), withheld=("actuator_lag",))
    found = score_experiments({"x": hidden}, tmp_path / "first", tmp_path / "out")
    assert found.groups.count == 1 and found.groups_holding.count == 0 and found.stayed.hits == 1


def test_members_that_are_all_there_are_no_question(tmp_path):
    written(tmp_path / "first" / "x", [GAIN], [[GAIN, RADIUS]])
    written(tmp_path / "out" / "x" / "again", [GAIN], [[GAIN, RADIUS]])
    (tmp_path / "out" / "x" / "experiment.json").write_text(json.dumps({"status": "done"}))
    found = score_experiments({"x": answer(RADIUS, GAIN)}, tmp_path / "first", tmp_path / "out")
    assert not found.questions


def test_commands_are_read_as_excite_writes_them(tmp_path):
    path = tmp_path / "next.csv"
    path.write_text("run,t,command.j1,enabled.j1\na,0,1,1\na,0.5,2,0\nb,0,3,1\nb,0.5,4,1\n")
    first, second = read_commanded_motions(path, ["effort.j1"])
    assert (first.name, second.name, first.sensors) == ("a", "b", ("effort.j1",))
    assert first.table(["j1"]).tolist() == [[1.0], [2.0]] and first.on(["j1"]).tolist() == [[1.0], [0.0]]
    with pytest.raises(BadInput, match="actuators j2, got"):
        first.table(["j2"])
    for text in ("", "a,b\n1,2\n", "t,command.j1\n0,x\n"):
        path.write_text(text)
        with pytest.raises(BadInput, match="not a valid command file"):
            read_commanded_motions(path)
