"""Make, run and score, with a stub in place of the diagnosis."""

import json
import multiprocessing
import re
import shlex
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from residual_mpc.blind import make as make_module
from residual_mpc.blind.make import MakeSettings, _plan, make_suite
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.run import RunSettings, run_suite
from residual_mpc.blind.score.score import score_suite
from residual_mpc.blind.suite import read_suite
from residual_mpc.cli.blind import blind
from residual_mpc.errors import BadInput

CANARY = "canary-5f1d9c"
STUB = Path(__file__).with_name("stub_diagnosis.py")


def stub(*told: str) -> str:
    return shlex.join([sys.executable, str(STUB), *told, "--"])


def small_case(family, level, seed, folder):
    """A case in no time, whose answer holds the canary."""
    if seed == 13:
        raise RuntimeError("unlucky")
    (folder / "case").mkdir(parents=True)
    (folder / "case" / "robot.toml").write_text(f"# {seed}\n")
    (folder / "case" / "run1.csv").write_text("t\n0\n")
    effects = () if level == "none" else (Planted("slope", None, {"rate": 0.1}, 5.0),)
    withheld = ("slope",) if level == "withheld" else ()
    return Answer(f"{family}-{level}-{seed}", family, level, seed, effects, withheld=withheld, notes={"c": CANARY})


@pytest.fixture
def suite(tmp_path, monkeypatch):
    monkeypatch.setattr(make_module, "make_case", small_case)
    settings = MakeSettings(("wheeled",), ("single", "none", "withheld"), cases=2, jobs=1)
    made = make_suite(settings, tmp_path / "suite", tmp_path / "answers")
    assert len(made.suite.cases) == 6 and not made.failed
    return tmp_path


def test_nothing_of_an_answer_travels_with_the_cases(suite):
    for path in (suite / "suite").rglob("*"):
        if path.is_file():
            text = path.read_text()
            assert CANARY not in text and "single" not in text and "none" not in text
    assert CANARY in "".join(p.read_text() for p in (suite / "answers").iterdir())


def test_nothing_of_an_answer_reaches_a_diagnosis(suite, monkeypatch):
    monkeypatch.setenv("SECRET_OF_THE_CALLER", CANARY)
    run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), jobs=2))
    for path in (suite / "results").glob("*/diagnosis.json"):
        seen = json.loads(path.read_text())["seen"]
        assert "robot.toml" in seen  # the stub did look
        assert CANARY not in seen and "answers" not in seen and path.parent.name not in seen


def test_a_withheld_candidate_is_taken_away(suite):
    run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), jobs=1))
    withheld = [e for e in read_suite(suite / "suite").cases if e.without]
    assert len(withheld) == 2
    for entry in withheld:
        seen = json.loads((suite / "results" / entry.name / "diagnosis.json").read_text())["seen"]
        assert "'--without', 'slope'" in seen


def test_a_sweep_resumes(suite):
    first = run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), jobs=1))
    assert (first.diagnosed, first.failed, first.resumed) == (6, 0, 0)
    lost = suite / "results" / "case-0002" / "run.json"
    lost.unlink()
    second = run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), jobs=1))
    assert (second.diagnosed, second.resumed) == (1, 5) and lost.exists()


@pytest.mark.parametrize(("told", "status"), [("crash", "failed"), ("sleep", "over 0.5 s")])
def test_a_failing_case_fails_alone_and_is_wrong(suite, told, status):
    summary = run_suite(suite / "suite", suite / "results", RunSettings(stub(told), jobs=2, timeout=0.5))
    assert summary.failed == 6
    record = json.loads((suite / "results" / "case-0001" / "run.json").read_text())
    assert record["status"] == status
    scores = score_suite(suite / "suite", suite / "answers", {"m": suite / "results"}, suite / "ledger.jsonl")
    assert scores.summaries[0].right.value == 0.0 and scores.summaries[0].right.count == 6


def test_scores_of_a_method_that_always_says_slope(suite):
    run_suite(suite / "suite", suite / "results", RunSettings(stub("effects", "slope", "-"), jobs=1))
    scores = score_suite(suite / "suite", suite / "answers", {"m": suite / "results"}, suite / "ledger.jsonl")
    (summary,) = scores.summaries
    assert summary.by_level["single"].value == 1.0 and summary.by_level["none"].value == 0.0
    assert summary.by_level["withheld"].value == 0.0 and summary.false_alarms.value == 1.0


def test_making_resumes_and_a_case_that_cannot_be_drawn_is_listed(tmp_path, monkeypatch):
    monkeypatch.setattr(make_module, "make_case", small_case)
    settings = MakeSettings(("wheeled",), ("single",), cases=4, first_seed=11, jobs=1)
    made = make_suite(settings, tmp_path / "suite", tmp_path / "answers")
    assert len(made.suite.cases) == 3 and "unlucky" in made.failed[0][1]

    def never(*_):
        raise AssertionError("was made before")

    monkeypatch.setattr(make_module, "make_case", never)
    again = make_suite(settings, tmp_path / "suite", tmp_path / "answers")
    assert again.suite.cases == made.suite.cases
    other = MakeSettings(("wheeled",), ("double",), cases=4, first_seed=11, jobs=1)
    before = sorted(p.name for p in (tmp_path / "suite" / "cases").iterdir())
    with pytest.raises(BadInput, match="with other families, levels"):
        make_suite(other, tmp_path / "suite", tmp_path / "answers")
    assert sorted(p.name for p in (tmp_path / "suite" / "cases").iterdir()) == before


def test_a_sweep_says_how_far_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(make_module, "make_case", small_case)
    settings = MakeSettings(("wheeled",), ("single",), cases=2, first_seed=20, jobs=1)
    said: list[tuple[str, float]] = []
    made = make_suite(settings, tmp_path / "suite", tmp_path / "answers", lambda text, done: said.append((text, done)))
    run_suite(tmp_path / "suite", tmp_path / "results", RunSettings(stub("no_gap"), jobs=2),
              lambda text, done: said.append((text, done)))  # fmt: skip
    names = [entry.name for entry in made.suite.cases]
    assert said == [(f"{n} ({k} of 2)", k / 2) for _ in ("make", "run") for k, n in enumerate(names, 1)]


def test_test_seeds_are_counted_when_they_are_opened(tmp_path, monkeypatch):
    monkeypatch.setattr(make_module, "make_case", small_case)
    settings = MakeSettings(("wheeled",), ("single",), cases=1, first_seed=100_000, jobs=1)
    make_suite(settings, tmp_path / "suite", tmp_path / "answers")
    run_suite(tmp_path / "suite", tmp_path / "results", RunSettings(stub("unknown"), jobs=1))
    for _ in range(2):
        scores = score_suite(tmp_path / "suite", tmp_path / "answers", {"m": tmp_path / "results"}, tmp_path / "l")
    assert len(scores.openings) == 2 and scores.openings[0].cases == 1


def test_a_family_may_have_a_number_of_cases_of_its_own():
    settings = MakeSettings(("wheeled=3", "arm"), ("single", "none"), cases=2, first_seed=7)
    drawn = sorted(tuple(job) for _, *job in _plan(settings))
    assert drawn == sorted(
        [("wheeled", level, seed) for level in ("single", "none") for seed in (7, 8, 9)]
        + [("arm", level, seed) for level in ("single", "none") for seed in (7, 8)]
    )
    for wrong in ("arm=0", "arm=", "arm=few"):
        with pytest.raises(BadInput):
            MakeSettings((wrong,), ("single",))


def test_bad_requests_are_one_clear_message(tmp_path):
    with pytest.raises(BadInput, match="all development or all test seeds"):
        MakeSettings(("wheeled",), ("single",), cases=5, first_seed=99_998)
    with pytest.raises(BadInput, match="Known levels"):
        MakeSettings(("wheeled",), ("easy",))
    with pytest.raises(BadInput, match="Known families"):
        MakeSettings(("submarine",), ("single",))
    with pytest.raises(BadInput, match="inside the suite"):
        make_suite(MakeSettings(("wheeled",), ("none",), 1), tmp_path, tmp_path / "answers")
    with pytest.raises(BadInput, match="contains no suite"):
        run_suite(tmp_path, tmp_path / "r", RunSettings())


def test_the_command_line_makes_runs_and_scores(suite):
    runner = CliRunner()
    place = {k: str(suite / k) for k in ("suite", "answers", "results", "page")}
    done = runner.invoke(
        blind, ["run", place["suite"], "--out", place["results"], "--command", stub("no_gap"), "--json"]
    )
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["run"]["diagnosed"] == 6
    done = runner.invoke(
        blind,
        [
            "score",
            place["suite"],
            "--results",
            place["results"],
            "--answers",
            place["answers"],
            "--out",
            place["page"],
            "--json",
        ],
    )
    assert done.exit_code == 0, done.output
    score = json.loads(done.stdout)["score"]
    wanted = {
        "cases",
        "right",
        "ci95",
        "by_level",
        "false_alarms",
        "target_right",
        "interval_coverage",
        "shrink_error",
        "calibration_error",
    }
    assert wanted <= set(score) and score["by_level"]["none"] == 1.0
    page = (suite / "page" / "blind.html").read_text()
    assert "<svg" in page and not re.search(r"(src|href)=.?https?:", page)


def test_the_engine_dask_runs_a_local_cluster_and_closes_it(suite):
    before = set(multiprocessing.active_children())
    summary = run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), jobs=2, engine="dask"))
    assert (summary.diagnosed, summary.failed) == (6, 0)
    assert set(multiprocessing.active_children()) <= before


def test_a_missing_engine_says_how_to_install_it(suite, monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    with pytest.raises(BadInput, match="pip install"):
        run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), engine="dask"))
    with pytest.raises(BadInput, match="Known engines"):
        RunSettings(engine="ray")
