"""The cases of outside checks: the same seed gives the same case, the scorer's marks, absent folders."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.findings import perfect, recorded, shared, skid, slow
from benchmarks.findings.__main__ import findings
from benchmarks.findings.catalogue import catalogue
from benchmarks.findings.noise import PoseNoise, ar1
from benchmarks.findings.page import page
from benchmarks.findings.records import Case, Truth
from benchmarks.findings.run import Outcome, Places, made, outcome, program_at
from benchmarks.findings.score import score
from benchmarks.findings.wheels import Drive, lagged, moved

RATIO = {"level": "slow", "planted": {"wheel_radius_mismatch": {"ratio": 1.04}}, "background": {}}
NONE = {"level": "none", "planted": {}}
CHANGED = {"level": "changed", "planted": {"x_gain_change": {"left": 0.5, "right": 0.5}}}


def said(verdict, *causes, confounded=()):
    """A diagnosis that names (effect, target, probability, {parameter: value})."""
    explanation = [
        {"effect": e, "target": t, "probability": p, "parameters": {k: {"value": v} for k, v in values.items()}}
        for e, t, p, values in causes
    ]
    groups = [[{"effect": e, "target": t} for e, t in group] for group in confounded]
    return {"verdict": verdict, "explanation": explanation, "confounded": groups}


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.parametrize("case", [perfect.cases()[7], slow.cases()[4], skid.cases()[2]], ids=lambda c: c.name)
def test_the_same_seed_gives_the_same_case(tmp_path, case):
    for name in ("once", "twice"):
        (tmp_path / name).mkdir()
        case.make(tmp_path / name, tmp_path)
    assert bytes_of(tmp_path / "once") == bytes_of(tmp_path / "twice")
    assert {"robot.toml", "truth.json"} < set(bytes_of(tmp_path / "once"))


def test_names_are_unique_and_every_rate_meets_every_noise():
    names = [case.name for case in catalogue()]
    assert len(names) == len(set(names))
    met = {(perfect.RATES[k % 5], perfect.KINDS[k % 3], (k // 15) % 2) for k in range(perfect.COUNT)}
    assert len(met) == 5 * 3 * 2


def test_a_drive_follows_the_closed_form_of_an_arc_and_of_a_lag():
    w, pose = moved(Drive(0.1, 0.5, delay=0.2), np.tile([2.0, 4.0], (100, 1)), 10.0, np.random.default_rng(0))
    turn, radius = 0.1 * 2 / 0.5, 0.3 / 0.4
    assert pose[-1] == pytest.approx(
        [radius * np.sin(10 * turn), radius * (1 - np.cos(10 * turn)), 10 * turn], rel=1e-5
    )
    step = np.concatenate([np.zeros((1, 2)), np.ones((1000, 2))])
    assert lagged(step, 0.25)[-1] == pytest.approx(1 - np.exp(-4), abs=2e-3)
    assert lagged(step, 0.25, acceleration=0.5)[-1] == pytest.approx(0.5, abs=1e-3)


def test_coloured_noise_is_stationary_with_the_stated_sigma():
    x = ar1(np.random.default_rng(1), (200_000,), 0.9)
    assert x.std() == pytest.approx(1, abs=0.02) and (x[1:] * x[:-1]).mean() == pytest.approx(0.9, abs=0.02)
    with pytest.raises(ValueError, match=r"rho must be in \[0, 1\)"):
        PoseNoise(rho=1.0)


def test_right_up_to_small_groups_that_hold_the_true_one():
    gain = ("actuator_gain", "right", 0.9, {"gain": 1.04})
    assert score(said("effects", gain), RATIO).mark == "wrong"
    group = [(gain[:2], ("wheel_radius_mismatch", None))]
    exchanged = score(said("effects", gain, confounded=group), RATIO)
    assert (exchanged.mark, exchanged.extras) == ("right", 0)
    large = [(*group[0], ("slope", None), ("dead_zone", None))]
    assert score(said("effects", gain, confounded=large), RATIO).mark == "wrong"
    left = ("actuator_gain", "left", 0.8, {"gain": 1.1})
    beside = score(said("effects", gain, left, confounded=group), RATIO)
    assert (beside.mark, beside.extras, beside.highest_wrong) == ("wrong", 1, 0.8)


def test_a_faint_background_is_no_error_and_other_extras_are():
    ratio = ("wheel_radius_mismatch", None, 0.97, {"ratio": 1.041})
    slope = ("slope", None, 0.6, {"rate": 0.003})
    assert score(said("effects", ratio, slope), RATIO | {"background": {"slope": {"rate": 0.003}}}).mark == "right"
    extra = score(said("effects", ratio, slope), RATIO)
    assert (extra.mark, extra.extras, extra.highest_wrong) == ("wrong", 1, 0.6)


def test_doubted_is_a_wrong_answer_that_says_so():
    assert score(said("partial", ("slope", None, 0.3, {"rate": 0.1})), RATIO).mark == "doubted"
    assert score(said("partial", ("slope", None, 0.7, {"rate": 0.1})), RATIO).mark == "wrong"
    assert score(said("no_gap"), RATIO).mark == "wrong"


def test_a_false_alarm_is_wrong_and_an_unnamed_cause_wants_partial_or_unknown():
    assert [score(said(v), NONE).mark for v in ("no_gap", "unknown", "partial")] == ["right", "wrong", "wrong"]
    assert [score(said(v), CHANGED).mark for v in ("effects", "unknown", "partial")] == ["wrong", "right", "right"]
    sag = score(said("partial", ("voltage_sag", None, 0.97, {"rate": 0.02})), CHANGED)
    assert (sag.mark, sag.highest_wrong) == ("right", 0.97)


def test_values_and_targets_and_what_cannot_be_there():
    truth = {
        "level": "recorded",
        "within": 1.5,
        "planted": {"coulomb_friction": recorded.KNOWN["c"]["coulomb_friction"]},
    }
    both = said("effects", *(("coulomb_friction", j, 0.97, {"torque": 0.12}) for j in ("shoulder", "elbow")))
    assert (score(both, truth).mark, score(both, truth).targets) == ("right", True)
    everywhere = score(said("effects", ("coulomb_friction", None, 0.97, {"torque": 0.164})), truth)
    assert (everywhere.mark, everywhere.targets) == ("right", True)
    elbow = score(said("effects", ("coulomb_friction", "elbow", 0.97, {"torque": 0.344})), truth)
    assert (elbow.mark, elbow.why) == ("wrong", "value of coulomb_friction")
    faint = score(said("partial", ("coulomb_friction", "elbow", 0.3, {"torque": 0.344})), truth)
    assert (faint.mark, faint.highest_wrong) == ("doubted", 0.0)
    lag = said("partial", ("actuator_lag", None, 0.9, {"time_constant": 0.1}))
    assert score(lag, CHANGED | {"forbidden": ["actuator_lag"]}).mark == "wrong"


def test_where_nobody_knows_the_cause_the_share_closed_counts():
    truth = {"level": "recorded", "planted": {}, "closes": 0.6}
    answer = said("effects", ("dead_zone", None, 0.9, {"width": 0.01}))
    assert [score(answer, truth, closed).mark for closed in (0.65, 0.06)] == ["right", "wrong"]


def test_edits_of_the_pendulum_conserve_what_they_do_not_change():
    model = '<inertial pos="0 0 -0.255693" mass="0.625568" diaginertia="0.009971 0.009971 0.0005"/>'
    lighter = recorded.lighter(model)
    assert 'mass="0.475568"' in lighter
    with pytest.raises(ValueError, match="0 times, wanted once"):
        recorded.longer(model)


def test_absent_folders_are_said(tmp_path):
    call = [
        "--out",
        str(tmp_path / "out"),
        "--shared",
        str(tmp_path / "none"),
        "--case",
        "pendulum_a_three",
        "--make-only",
    ]
    done = CliRunner().invoke(findings, call)
    assert done.exit_code == 0, done.output
    assert "The folder shared/cases is absent" in done.output and "The folder shared/data is absent" in done.output
    assert "pendulum_a_three" in done.output and "is absent" in done.output.splitlines()[-1]
    assert shared.cases(tmp_path / "none") == []


def test_shared_cases_are_copied_without_what_judges_them(tmp_path):
    source = tmp_path / "shared" / "cases" / "slow_mismatch"
    source.mkdir(parents=True)
    (source / "truth.json").write_text(json.dumps(RATIO))
    for name in ("robot.toml", "run1.csv.gz", "fresh.csv.gz"):
        (source / name).write_bytes(b"")
    (case,) = shared.cases(source.parent)
    places = Places(tmp_path / "out", source.parent, tmp_path)
    assert made(case, places) == "" and case.finding == 6
    assert set(bytes_of(places.case(case))) == {"truth.json", "robot.toml", "run1.csv.gz"}


PROGRAM = """#!{python}
import json, sys
if sys.argv[1] == "--version":
    print("program 1")
else:
    with open({calls!r}, "a") as log:
        log.write(" ".join(sys.argv[1:]) + chr(10))
    diagnosis = {{"verdict": "effects", "explanation": [], "confounded": []}}
    print(json.dumps(diagnosis if sys.argv[1] == "diagnose" else {{"gap": {{"nominal": 0.8, "model": 0.2}}}}))
"""


def test_a_case_is_diagnosed_once_a_program_and_judged_on_the_other_motions(tmp_path):
    data, calls = tmp_path / "data", tmp_path / "calls.txt"
    (data / "arm").mkdir(parents=True)
    for name in ("slow", "fast", "wave"):
        (data / "arm" / f"{name}.parquet").write_bytes(b"")
    tool = tmp_path / "residual-mpc"
    tool.write_text(PROGRAM.format(python=sys.executable, calls=str(calls)))
    tool.chmod(0o755)
    case = Case(
        "arm", 8, lambda to, _: Truth("recorded", closes=0.6).write(to), data="arm", motions=("slow",), judged=True
    )
    places = Places(tmp_path / "out", tmp_path, data)
    first, second = (outcome(case, places, program_at(tool)) for _ in range(2))
    assert first == second and first.closed == pytest.approx(0.75) and first.document["verdict"] == "effects"
    diagnosed, judged = calls.read_text().splitlines()
    assert "slow.parquet" in diagnosed and "fast.parquet" not in diagnosed
    assert "slow.parquet" not in judged and "fast.parquet" in judged and "wave.parquet" in judged
    outcome(case, places, program_at(tool), again=True)
    assert len(calls.read_text().splitlines()) == 4


def test_the_page_counts_marks_and_says_what_was_not_diagnosed():
    case = Case("slow_x", 6, lambda folder, data: None)
    good = Outcome(case, RATIO, said("effects", ("wheel_radius_mismatch", None, 0.97, {"ratio": 1.04})), 3.0)
    text = page([good, Outcome(case, None, None, trouble="data is absent")], "residual-mpc 9", [])
    assert "| 6 | 2 | 1 | 0 | 0 | 1 |" in text and "not diagnosed: data is absent" in text
    assert "`effects`: wheel_radius_mismatch 1.04 (0.97) | right |" in text
