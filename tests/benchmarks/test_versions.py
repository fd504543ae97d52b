"""The cost of a diagnosis beside an earlier version: which cases, what a row says, and what is not done twice."""

import json

import click
import pytest

from benchmarks import versions as module
from benchmarks.versions import Case, Cost, answer, cases_of, diagnosed, summary, unpacked


def cost(seconds, memory=1e9):
    return Cost(seconds, int(memory), 0)


def test_cases_are_those_of_suites_and_folders_by_themselves(tmp_path):
    for name in ("suite/cases/case-0001", "suite/cases/case-0002", "alone"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "alone" / "robot.toml").write_text('name = "r"\n')
    with pytest.raises(click.UsageError, match="neither a suite"):
        cases_of([tmp_path / "alone"])
    (tmp_path / "alone" / "run1.csv").write_text("t\n0\n")
    entries = [
        {"name": f"case-000{k}", "family": "arm", "commitment": "00", "without": without}
        for k, without in ((2, ["payload"]), (1, []))
    ]
    suite = {"seeds": "development", "version": "1", "cases": entries}
    (tmp_path / "suite" / "suite.json").write_text(json.dumps(suite))
    found = cases_of([tmp_path / "suite", tmp_path / "alone"])
    assert [(c.name, c.family, c.without) for c in found] == [
        ("case-0002", "arm", ("payload",)), ("case-0001", "arm", ()), ("alone", "robot", ()),
    ]  # fmt: skip
    with pytest.raises(click.UsageError, match="case-0001, case-0002 twice"):
        cases_of([tmp_path / "suite", tmp_path / "suite"])


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
    place = tmp_path / "case.1"
    place.mkdir()
    (place / "robot.toml").write_text('name = "r"\n')
    (place / "run1.csv").write_text("t\n0\n")
    return Case("case.1", place, "robot", ("payload",))


def test_each_version_runs_its_own_files(case, tmp_path):
    """Also where the folder that one calls from holds another version."""
    tree = tmp_path / "tree"
    (tree / "residual_mpc" / "cli").mkdir(parents=True)
    for name in ("__init__.py", "cli/__init__.py"):
        (tree / "residual_mpc" / name).write_text("")
    (tree / "residual_mpc" / "cli" / "main.py").write_text("import sys\ndef main(): print('here', *sys.argv[1:])\n")
    assert diagnosed(case, tree, "abc", tmp_path / "out" / "case.1").status == 0
    said = (tmp_path / "out" / "case.1.log").read_text().split()
    assert said[:2] == ["here", "diagnose"] and said[-4:-1] == ["--without", "payload", "--out"]
    assert str(case.folder / "run1.csv") in said


def test_a_child_is_timed_with_its_first_answer_and_not_run_again(case, tmp_path, monkeypatch):
    program = "import sys, time; print('first look: here'); sys.stdout.flush(); time.sleep(0.3); sum(range(10**6))"
    monkeypatch.setattr(module, "PROGRAM", program)
    found = diagnosed(case, tmp_path, "abc", tmp_path / "out" / "case.1")
    assert found.status == 0 and 0.0 < found.seconds < 10.0 and found.memory > 1e6
    assert found.first is not None and found.first > 0.0
    assert json.loads((tmp_path / "out" / "case.1" / "run.json").read_text())["status"] == "done"
    monkeypatch.setattr(module, "PROGRAM", "raise SystemExit(3)")
    assert diagnosed(case, tmp_path, "abc", tmp_path / "out" / "case.1") == found
    assert diagnosed(case, tmp_path, "def", tmp_path / "out" / "case.1").status == 3  # another version
    other = diagnosed(case, tmp_path, "abc", tmp_path / "out" / "case.2")  # the names differ behind a dot
    assert other.status == 3 and other.first is None
    assert json.loads((tmp_path / "out" / "case.2" / "run.json").read_text())["status"] == "exit status 3"


def test_an_unknown_commit_is_named_and_leaves_nothing(tmp_path):
    with pytest.raises(click.UsageError, match="no-such-commit"):
        unpacked("no-such-commit", tmp_path / "tree")
    assert not (tmp_path / "tree").exists()
