"""The cost of a diagnosis beside an earlier version: which cases, what a row says, and what is not done twice."""

import json
from pathlib import Path

import pytest

from benchmarks import versions as module
from benchmarks.versions import Cost, answer, diagnosed, folders, summary


def cost(seconds, memory=1e9):
    return Cost(seconds, int(memory), 0)


def test_cases_are_folders_with_a_robot_or_all_below(tmp_path):
    for name in ("suite/cases/case-0002", "suite/cases/case-0001", "alone"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "robot.toml").write_text('name = "r"\n')
    found = folders([tmp_path / "suite", tmp_path / "alone"])
    assert [f.name for f in found] == ["case-0001", "case-0002", "alone"]


def test_the_summary_has_ratios_of_cases_and_of_all_together():
    text = summary("arm", [(cost(10.0), cost(20.0)), (cost(30.0), cost(15.0, 2e9)), (cost(10.0), cost(10.0))])
    assert text == (
        "arm, 3 cases: median 10.0 s before, 15.0 s now; ratio of each case 1.00 in the median (0.50 to 2.00); all "
        "together 0.90; largest memory 1.00 and 2.00 GB"
    )


def test_an_answer_is_a_verdict_with_names_or_a_failure(tmp_path):
    assert answer(tmp_path) == "failed"
    explanation = [{"effect": "dead_zone", "target": "j2", "probability": 0.8}]
    (tmp_path / "diagnosis.json").write_text(json.dumps({"verdict": "partial", "explanation": explanation}))
    assert answer(tmp_path) == "`partial` dead_zone j2 0.80"


@pytest.fixture
def case(tmp_path):
    place = tmp_path / "case"
    place.mkdir()
    (place / "robot.toml").write_text('name = "r"\n')
    (place / "run1.csv").write_text("t\n0\n")
    return place


def test_a_child_is_timed_with_its_first_answer_and_not_run_again(case, tmp_path, monkeypatch):
    program = "import sys, time; print('first look: here'); sys.stdout.flush(); time.sleep(0.3); sum(range(10**6))"
    monkeypatch.setattr(module, "PROGRAM", program)
    found = diagnosed(case, tmp_path, tmp_path / "out" / "case")
    assert found.status == 0 and 0.0 < found.seconds < 10.0 and found.memory > 1e6
    assert found.first is not None and found.first > 0.0
    assert "first look" in (tmp_path / "out" / "case.log").read_text()
    monkeypatch.setattr(module, "PROGRAM", "raise SystemExit(3)")
    assert diagnosed(case, tmp_path, tmp_path / "out" / "case") == found


def test_a_child_that_fails_says_so(case, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PROGRAM", "raise SystemExit(3)")
    found = diagnosed(case, Path(tmp_path), tmp_path / "out" / "case")
    assert found.status == 3 and found.first is None
