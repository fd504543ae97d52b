"""What explains a wrong answer, with a stub in place of the diagnosis."""

import json
import shlex
import shutil
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from residual_mpc.blind import make as make_module
from residual_mpc.blind.explain.explain import ExplainSettings, explain_suite, fault_of
from residual_mpc.blind.explain.truth_gaps import GapOverHorizons
from residual_mpc.blind.make import MakeSettings, make_suite
from residual_mpc.blind.records import Answer, Planted
from residual_mpc.blind.run import RunSettings, run_suite
from residual_mpc.blind.score.explained import read_explained
from residual_mpc.blind.score.score import score_suite
from residual_mpc.cli.blind import blind
from residual_mpc.errors import BadInput

STUB = Path(__file__).with_name("stub_diagnosis.py")


def stub(*told: str) -> str:
    return shlex.join([sys.executable, str(STUB), *told, "--"])


def gap(at_one_second: float, at_five: float | None = None, floor: float = 0.02) -> GapOverHorizons:
    longer = {} if at_five is None else {5.0: (at_five, floor)}
    return GapOverHorizons(at_one_second, {1.0: (at_one_second, floor), **longer})


def test_a_fit_that_predicts_worse_than_the_planted_effects_is_at_fault():
    assert fault_of({"only": gap(0.1), "drawn": gap(0.05), "best fit": gap(0.03)}) == "fit"
    assert fault_of({"only": gap(0.031), "drawn": gap(0.05), "best fit": gap(0.03)}) == "judgement"
    assert fault_of({"only": gap(0.03, 0.1), "best fit": gap(0.03, 0.03)}) == "fit"


def test_a_model_whose_best_values_leave_a_large_gap_is_at_fault():
    assert fault_of({"only": gap(0.1), "drawn": gap(0.09), "best fit": gap(0.08)}) == "model"
    assert fault_of({"only": gap(0.1), "drawn": gap(0.09, floor=0.045)}) == "fit"  # no larger than twice the floor
    hidden = {"only": gap(0.1), "best fit": gap(0.08), "with background": gap(0.03)}
    assert fault_of(hidden) == "background"
    assert fault_of({}) == "not measured"


@pytest.fixture
def suite(tmp_path, monkeypatch):
    def small_case(family, level, seed, folder):
        (folder / "case").mkdir(parents=True)
        (folder / "case" / "robot.toml").write_text(f"# {seed}\n")
        (folder / "case" / "run1.csv").write_text("t\n0\n")
        effects = () if level in ("none", "unknown") else (Planted("slope", None, {"rate": 0.1}, 5.0),)
        unknown = ("gusts",) if level == "unknown" else ()
        return Answer(f"{family}-{level}-{seed}", family, level, seed, effects, unknown=unknown)

    monkeypatch.setattr(make_module, "make_case", small_case)
    make_suite(
        MakeSettings(("wheeled",), ("single", "none", "unknown"), 1, 0, 1), tmp_path / "suite", tmp_path / "answers"
    )
    return tmp_path


def explained(suite, *told):
    settings = ExplainSettings(stub(*told), jobs=1)
    place = suite / "suite", suite / "answers", suite / "results", suite / "out", suite / "ledger.jsonl"
    return explain_suite(*place, settings)


def test_answers_stay_sealed_until_every_case_is_diagnosed(suite):
    with pytest.raises(BadInput, match="3 of 3 cases are not diagnosed yet"):
        explained(suite, "no_gap")
    assert not (suite / "out").exists()


def test_wrong_answers_are_diagnosed_again_with_the_planted_effects_alone(suite):
    run_suite(suite / "suite", suite / "results", RunSettings(stub("effects", "track_width", "-"), jobs=1))
    found = explained(suite, "effects", "slope", "-")
    assert sorted(e.fault for e in found.wrong) == ["false alarm", "search", "stand-in"]
    (searched,) = (e for e in found.wrong if e.fault == "search")
    assert searched.planted == (("slope", None),) and searched.only_named == (("slope", None),)
    seen = json.loads((suite / "out" / searched.case / "diagnosis.json").read_text())["seen"]
    assert "'--only', 'slope'" in seen
    assert read_explained(suite / "out") == found.wrong
    again = explained(suite, "crash")
    assert again.resumed == 3 and again.wrong == found.wrong
    shutil.rmtree(suite / "results")
    run_suite(suite / "suite", suite / "results", RunSettings(stub("effects", "backlash", "-"), jobs=1))
    other = explained(suite, "effects", "slope", "-")
    assert other.resumed == 0 and all(e.named == (("backlash", None),) for e in other.wrong)


def test_a_diagnosis_that_fails_again_and_gaps_that_cannot_be_measured(suite):
    run_suite(suite / "suite", suite / "results", RunSettings(stub("no_gap"), jobs=1))
    assert sorted(e.fault for e in explained(suite, "crash").wrong) == ["failed", "unseen"]
    settings = ExplainSettings(stub("unknown"), jobs=1)
    place = suite / "suite", suite / "answers", suite / "results", suite / "other", suite / "ledger.jsonl"
    wrong = explain_suite(*place, settings).wrong
    assert sorted(e.fault for e in wrong) == ["not measured", "unseen"]


def test_the_command_line_explains_and_the_page_shows_it(suite):
    run_suite(suite / "suite", suite / "results", RunSettings(stub("effects", "track_width", "-"), jobs=1))
    place = {k: str(suite / k) for k in ("suite", "answers", "results", "out", "page")}
    told = [place["suite"], "--results", place["results"], "--answers", place["answers"], "--out"]
    done = CliRunner().invoke(blind, ["explain", *told, place["out"], "--command", stub("effects", "slope", "-")])
    assert done.exit_code == 0, done.output
    assert "3 of 3 answers are wrong" in done.stdout and "search          1" in done.stdout
    done = CliRunner().invoke(blind, ["score", *told, place["page"], "--explained", place["out"]])
    assert done.exit_code == 0, done.output
    shown = (suite / "page" / "blind.html").read_text()
    assert "right once told which effects to consider" in shown


def test_a_page_refuses_what_explains_other_answers(suite):
    run_suite(suite / "suite", suite / "results", RunSettings(stub("effects", "track_width", "-"), jobs=1))
    explained(suite, "effects", "slope", "-")
    run_suite(suite / "suite", suite / "others", RunSettings(stub("no_gap"), jobs=1))
    results = {"other": suite / "others", "diagnose": suite / "results"}
    with pytest.raises(BadInput, match="not the wrong answers of other"):
        score_suite(suite / "suite", suite / "answers", results, suite / "ledger.jsonl", explained=suite / "out")
