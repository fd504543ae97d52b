"""New runs confirm what is there, exclude what is not, and say so where they cannot tell."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run, write_run
from test_excite import LAG, PERIOD, driven, gently

import residual_mpc as rm
from residual_mpc.cli.main import main
from residual_mpc.diagnosis.fit.least_squares import Fit
from residual_mpc.errors import BadInput
from residual_mpc.experiment.confirmation.agreement import Expected, found_sigma, mismatch
from residual_mpc.experiment.confirmation.document import confirmed_document, explanations_in
from residual_mpc.experiment.confirmation.inputs import DiagnosedExplanation, with_combinations
from residual_mpc.experiment.confirmation.records import Confirmation, ExplanationTest
from residual_mpc.experiment.confirmation.settings import ConfirmationSettings
from residual_mpc.models.model_file import values_of
from residual_mpc.models.settings import Knob, Term

ONLY = ("actuator_lag", "command_delay")
LATE = {"command_delay": {"delay": 0.08}}
LIMIT = {"saturation": {"limit": 5.0}}


def steps(t: np.ndarray) -> np.ndarray:
    """(n, 2): steps of both wheels, between which a lag and a delay differ."""
    return np.stack([6.0 * np.sign(np.sin(2 * np.pi * 0.4 * t)), 4.0 * np.sign(np.sin(2 * np.pi * 0.27 * t))], axis=1)


def saved(run: Any, folder: Path) -> rm.Runs:
    robot = rm.load_robot(folder / "robot.toml")
    return rm.read_runs(robot, write_run(run, folder))


@pytest.fixture(scope="module")
def gentle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rover with a lag, driven so gently that a delay does as well."""
    folder = tmp_path_factory.mktemp("gentle")
    (folder / "robot.toml").write_text(ROBOT)
    t = PERIOD * np.arange(401)
    runs = saved(driven("gentle", t, gently(t), LAG, False), folder)
    found = rm.diagnose(rm.load_robot(folder / "robot.toml"), runs, only=ONLY, out=folder / "out")
    assert len(found.document["confounded"]) == 1 and len(found.document["alternatives"]) == 1
    return folder


def diagnosed(folder: Path, faults: dict[str, Any], *only: str) -> Path:
    """A rover with one fault, and in `out` a diagnosis of two runs that names it and nothing else."""
    (folder / "robot.toml").write_text(ROBOT)
    robot = rm.load_robot(folder / "robot.toml")
    files = [write_run(rover_run(f"run{k}", faults, seconds=16.0, seed=k), folder) for k in range(2)]
    found = rm.diagnose(robot, rm.read_runs(robot, files), only=only, out=folder / "out")
    assert [e["effect"] for e in found.explanation] == list(faults) and not found.document["confounded"]
    return folder


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rover whose commands are late."""
    return diagnosed(tmp_path_factory.mktemp("late"), LATE, *ONLY, "track_width", "dead_zone")


def confirmed(folder: Path, faults: dict, name: str, *changed: str, out: Path | None = None) -> rm.Confirmation:
    robot = rm.load_robot(folder / "robot.toml")
    runs = saved(rover_run(name, faults, seconds=16.0, seed=7), folder)
    return rm.confirm(robot, folder / "out" / "diagnosis.json", runs, changed=changed, out=out)


def probability(found: rm.Confirmation) -> float:
    return float(found.explanation[0]["probability"])


@pytest.mark.parametrize("faults", [LAG, {"command_delay": {"delay": 0.05}}], ids=["lag", "delay"])
def test_a_run_that_separates_a_group_settles_it(gentle: Path, faults: dict, tmp_path: Path) -> None:
    """Whichever member is there: where the diagnosis had preferred the other, it is exchanged."""
    (true,) = faults
    t = PERIOD * np.arange(401)
    runs = saved(driven(f"steps_{true}", t, steps(t), faults, False), gentle)
    found = rm.confirm(rm.load_robot(gentle / "robot.toml"), gentle / "out" / "diagnosis.json", runs, out=tmp_path)
    (effect,) = found.explanation
    assert effect["effect"] == true and "experiment" in effect["evidence"] and effect["probability"] > 0.9
    assert found.document["confounded"] == [] and found.document["next_experiment"] is None
    assert found.outcomes[true] == "agrees" and ("exclude" in found.lines()[0] or "count against" in found.lines()[0])
    (size,) = effect["parameters"].values()
    assert size["ci95"][0] <= 0.05 <= size["ci95"][1] or abs(size["value"] - 0.05) < 0.01
    values = json.loads((tmp_path / "model.json").read_text())["values"]
    assert {v["effect"] for v in values} == {true}
    assert "Test on new runs" in (tmp_path / "report.html").read_text()
    document = found.document
    assert document["alternatives"] == [] and document["model"]["values"][0]["effect"] == true
    (other,) = (
        c["probability"]
        for c in document["candidates"]
        if c["effect"] in ONLY and c["effect"] != true and not c["target"]
    )
    assert other < 0.05


def test_a_run_that_does_not_separate_a_group_leaves_it(gentle: Path) -> None:
    t = PERIOD * np.arange(401)
    runs = saved(driven("gentle_again", t, gently(t + 2.0), LAG, False), gentle)
    found = rm.confirm(rm.load_robot(gentle / "robot.toml"), gentle / "out" / "diagnosis.json", runs)
    before = json.loads((gentle / "out" / "diagnosis.json").read_text())
    assert set(found.outcomes.values()) == {"open"}
    assert found.document["confounded"] == before["confounded"] and found.document["next_experiment"]
    assert probability(found) == pytest.approx(before["explanation"][0]["probability"])
    assert found.lines()[0].startswith("The new runs neither confirm nor contradict the diagnosis")


def test_the_same_effect_in_new_runs_is_confirmed(late: Path) -> None:
    found = confirmed(late, LATE, "again")
    assert found.outcomes == {"command_delay": "agrees"} and found.verdict == "effects"
    row = found.to_frame().iloc[0]
    assert row["low"] <= row["found"] <= row["high"] and row["unit"] == "s" and "0.08" in f"{row['found']:.2f}"
    assert "confirmed" in found._repr_html_()
    assert "experiment" in found.explanation[0]["evidence"]
    gap = found.document["confirmation"]["gaps"][0]
    assert gap["explained"] < 0.3 * gap["nominal"]


def test_an_effect_that_is_gone_is_denied(late: Path) -> None:
    """Where the nominal model leaves nothing to explain. Where something else is wrong, that may hide it."""
    found = confirmed(late, {}, "gone")
    assert found.outcomes == {"command_delay": "denies"} and probability(found) <= 0.45
    assert found.document["verdict_sentence"].startswith("Possibly commands take effect")
    assert found.verdict == "partial" and "The new runs leave a larger gap" in found.document["verdict_sentence"]
    assert "worse than the nominal one" in found.lines()[0]
    other = confirmed(late, {"track_width": {"scale": 1.2}}, "other")
    assert other.outcomes == {"command_delay": "open"} and other.verdict == "partial"
    assert probability(other) < 0.85  # what these runs leave may be what it was taken for


def test_a_known_change_is_evidence_of_its_own(late: Path) -> None:
    shorter = {"command_delay": {"delay": 0.03}}
    told = confirmed(late, shorter, "shorter", "command_delay=0.03")
    assert told.outcomes == {"command_delay": "agrees"} and "counterfactual" in told.explanation[0]["evidence"]
    assert told.document["confirmation"]["changed"][0]["value"] == 0.03
    by = confirmed(late, shorter, "by", "command_delay-=0.05")
    assert by.outcomes == {"command_delay": "agrees"}
    assert confirmed(late, shorter, "untold").outcomes == {"command_delay": "other size"}
    removed = confirmed(late, {}, "removed", "command_delay=none")
    assert removed.outcomes == {"command_delay": "agrees"}
    assert "removed" in "\n".join(removed.lines())


def test_a_known_change_of_another_amount_is_told(late: Path) -> None:
    """The runs show how late the robot is: neither as before nor as stated."""
    found = confirmed(late, {"command_delay": {"delay": 0.045}}, "half", "command_delay=none")
    assert found.outcomes == {"command_delay": "other size"}
    assert "give a different size for command delay" in found.lines()[0]
    assert "counterfactual" not in found.explanation[0]["evidence"]


def test_a_model_that_leaves_much_confirms_nothing(late: Path) -> None:
    """Whatever else is wrong on the new runs may look like the effect; where the user changed it, it does not."""
    wider = {"track_width": {"scale": 1.2}}
    found = confirmed(late, {**LATE, **wider}, "wider")
    before = json.loads((late / "out" / "diagnosis.json").read_text())["explanation"][0]["probability"]
    assert found.outcomes == {"command_delay": "open"}
    assert not found.document["confirmation"]["explains_all"]
    assert probability(found) <= before and "only a known change can confirm them" in found.lines()[0]
    changed = confirmed(late, {"command_delay": {"delay": 0.03}, **wider}, "wider_changed", "command_delay=0.03")
    assert changed.outcomes == {"command_delay": "agrees"}


def test_what_stays_beside_a_replaced_effect_has_the_numbers_of_the_kept_model(gentle: Path) -> None:
    document = json.loads((gentle / "out" / "diagnosis.json").read_text())
    (diagnosed,) = explanations_in(document)[:1]
    (gone,), stays, came = diagnosed.terms, Term("track_width", None), Term("sensor_delay", None)
    row = {"effect": "track_width", "target": None, "parameter": "scale", "value": 1.1}
    size = {"scale": {"value": 1.1, "ci95": [1.08, 1.12], "unit": "1"}}
    document["explanation"].append({**document["explanation"][0], "effect": "track_width", "parameters": size})
    document["model"]["values"].append(row)
    own = ExplanationTest((gone, stays), (), values_of(document["model"]["values"]), 0.3, 0.3, 100.0, True, True)
    values = {Knob("sensor_delay", None, "delay"): 0.05, Knob("track_width", None, "scale"): 1.14}
    new = ExplanationTest((came,), (gone,), values, 0.02, 0.02, 0.0, False, False, (1,))
    found = confirmed_document(document, Confirmation((own, new), 1, (), (), True), False, ConfirmationSettings())
    track = next(e for e in found["explanation"] if e["effect"] == "track_width")
    assert track["parameters"]["scale"] == {"value": 1.14, "ci95": [1.08, 1.14], "unit": "1"}
    assert {v["effect"]: v["value"] for v in found["model"]["values"]} == {"sensor_delay": 0.05, "track_width": 1.14}


@pytest.fixture(scope="module")
def ambiguous(late: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a rover with a diagnosis that names the wrong one of two twins twice: a late sensor for late
    commands, and a gain for a wheel radius."""
    folder = tmp_path_factory.mktemp("ambiguous")
    (folder / "robot.toml").write_text(ROBOT)
    document = json.loads((late / "out" / "diagnosis.json").read_text())
    sizes = {"sensor_delay": ("delay", 0.08, "s"), "actuator_gain": ("gain", 0.9, "1"),
             "command_delay": ("delay", 0.08, "s"), "wheel_radius": ("scale", 0.9, "1")}  # fmt: skip

    def row(effect: str) -> dict[str, Any]:
        return {"effect": effect, "target": None, "parameter": sizes[effect][0], "value": sizes[effect][1]}

    def named(effect: str) -> dict[str, Any]:
        name, value, unit = sizes[effect]
        size = {name: {"value": value, "ci95": [0.97 * value, 1.03 * value], "unit": unit}}
        return {**document["explanation"][0], "effect": effect, "probability": 0.48, "parameters": size}

    own, twin = ("sensor_delay", "actuator_gain"), ("command_delay", "wheel_radius")
    document["explanation"] = [named(e) for e in own]
    document["model"]["values"] = [row(e) for e in own]
    document["alternatives"] = [
        {"effects": [{"effect": b, "target": None}], "instead_of": [{"effect": a, "target": None}], "confounded": True,
         "values": [row(b), *(row(x) for x in own if x != a)], "ratio": 0.1}
        for a, b in zip(own, twin, strict=True)
    ]  # fmt: skip
    members = [[{"effect": e, "target": None} for e in pair] for pair in zip(own, twin, strict=True)]
    document["confounded"] = members
    document["candidates"] = [{**m, "probability": 0.48, "shrink": 0.5} for pair in members for m in pair]
    document["run_files"], document["runs"] = [], []
    (folder / "out").mkdir()
    (folder / "out" / "diagnosis.json").write_text(json.dumps(document))
    return folder


def test_a_change_that_settles_one_ambiguity_leaves_the_other(ambiguous: Path) -> None:
    """The radius was put right: the gain goes for that, and nothing tells which delay it is."""
    found = confirmed(ambiguous, LATE, "radius", "wheel_radius=none")
    assert found.outcomes["wheel_radius"] == "agrees" and found.outcomes["actuator_gain"] == "denies"
    assert found.outcomes["sensor_delay"] == "open"
    (other,) = found.document["alternatives"]
    assert other["instead_of"] == [{"effect": "sensor_delay", "target": None}]
    assert [e["effect"] for e in other["effects"]] == ["command_delay"]
    assert {v["effect"] for v in other["values"]} == {"command_delay", "wheel_radius"}
    assert [[m["effect"] for m in g] for g in found.document["confounded"]] == [["sensor_delay", "command_delay"]]
    listed = {c["effect"]: c["probability"] for c in found.document["candidates"]}
    assert listed["wheel_radius"] > 0.9 and listed["actuator_gain"] < 0.1
    assert listed["sensor_delay"] == pytest.approx(0.48, abs=0.03) == listed["command_delay"]


def test_the_truth_may_be_on_the_other_side_of_both_ambiguities(ambiguous: Path) -> None:
    """Both causes were removed by the amounts that their twins had: what is named is neither of the first two."""
    changes = ("command_delay=none", "wheel_radius=none")
    found = confirmed(ambiguous, {}, "both", *changes)
    assert {e["effect"] for e in found.explanation} == {"command_delay", "wheel_radius"}
    assert found.outcomes["sensor_delay"] == found.outcomes["actuator_gain"] == "denies"
    assert found.document["alternatives"] == [] and found.document["confounded"] == []
    assert {v["effect"] for v in found.document["model"]["values"]} == {"command_delay", "wheel_radius"}
    said = "\n".join(found.lines())
    assert "with command delay and wheel radius instead of sensor delay and actuator gain" in said


def test_what_stays_open_of_three_members_beside_a_replaced_pair(ambiguous: Path) -> None:
    """A delay or a lag for one effect, a radius for the other: delay and radius are kept, lag and radius are open;
    an interval with an open end is no obstacle."""
    document = json.loads((ambiguous / "out" / "diagnosis.json").read_text())
    document["explanation"][0]["parameters"]["delay"]["ci95"][1] = None
    sensor, gain, delay, radius, lag = (
        Term(e, None) for e in ("sensor_delay", "actuator_gain", "command_delay", "wheel_radius", "actuator_lag")
    )
    third = {**document["alternatives"][0], "effects": [{"effect": "actuator_lag", "target": None}]}
    document["alternatives"].append(third)
    values = values_of(document["model"]["values"])

    def explained(came: Any, gone: Any, above: float, parts: tuple[int, ...], nowhere: bool = False) -> ExplanationTest:
        return ExplanationTest(came, gone, values, 0.1, 0.1, above, above > 14.0, nowhere, parts)

    tests = (
        explained((sensor, gain), (), 100.0, (), True),
        explained((delay,), (sensor,), 0.0, (1,)), explained((radius,), (gain,), 0.0, (2,)),
        explained((lag,), (sensor,), 3.0, (3,)),
        explained((delay, radius), (sensor, gain), 0.0, (1, 2)), explained((radius, lag), (gain, sensor), 3.0, (2, 3)),
    )  # fmt: skip
    singles = [replace(t, excluded=len(t.parts) == 1 or t.excluded) for t in tests]
    found = confirmed_document(document, Confirmation(tuple(singles), 4, (), (), True), False, ConfirmationSettings())
    (other,) = found["alternatives"]
    assert [e["effect"] for e in other["effects"]] == ["actuator_lag"]
    assert [e["effect"] for e in other["instead_of"]] == ["command_delay"]


def test_combinations_exchange_different_effects() -> None:
    a, b, c, d = (Term(e, None) for e in ("sensor_delay", "actuator_gain", "command_delay", "wheel_radius"))

    def explained(terms: tuple[Term, ...], instead: tuple[Term, ...], size: float) -> DiagnosedExplanation:
        values = {Knob(t.effect, None, "x"): size for t in {a, b, *terms} - set(instead)}
        return DiagnosedExplanation(terms, instead, values)

    own = explained((a, b), (), 1.0)
    others = [explained((c,), (a,), 2.0), explained((d,), (a,), 3.0), explained((d,), (b,), 4.0)]
    first, *more = with_combinations([own, *others], 12)[4:]
    assert first.terms == (c, d) and first.instead_of == (a, b) and more == []
    assert first.values == {Knob("command_delay", None, "x"): 2.0, Knob("wheel_radius", None, "x"): 4.0}
    assert len(with_combinations([own, *others], 0)) == 4


def test_a_change_that_does_not_show_speaks_against_the_effect(late: Path) -> None:
    """The user removed what was named, and the robot is as late as before."""
    found = confirmed(late, LATE, "unmoved", "command_delay=none")
    assert found.outcomes == {"command_delay": "denies"} and probability(found) < 0.9


def test_what_cannot_be_confirmed_is_refused(late: Path, tmp_path: Path) -> None:
    robot = rm.load_robot(late / "robot.toml")
    seen = rm.read_runs(robot, late / "run0.csv")
    with pytest.raises(BadInput, match="used in the diagnosis"):
        rm.confirm(robot, late / "out" / "diagnosis.json", seen)
    document = json.loads((late / "out" / "diagnosis.json").read_text())
    nothing = tmp_path / "nothing.json"
    nothing.write_text(json.dumps({**document, "explanation": [], "verdict": "unknown"}))
    runs = saved(rover_run("fresh", LATE, seconds=8.0, seed=9), late)
    with pytest.raises(BadInput, match="names no effect"):
        rm.confirm(robot, nothing, runs)
    with pytest.raises(BadInput, match="overwrite"):
        rm.confirm(robot, late / "out" / "diagnosis.json", runs, out=late / "out")
    with pytest.raises(BadInput, match="outside"):
        rm.confirm(robot, late / "out" / "diagnosis.json", runs, changed="command_delay=-0.2")
    copy = late / "copy.csv"
    copy.write_text((late / "run0.csv").read_text())
    with pytest.raises(BadInput, match="used in the diagnosis"):
        rm.confirm(robot, late / "out" / "diagnosis.json", rm.read_runs(robot, copy))
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps({**document, "explanation": [{"effect": "command_delay"}]}))
    with pytest.raises(BadInput, match="cannot be read"):
        rm.confirm(robot, broken, runs)
    once = rm.confirm(robot, late / "out" / "diagnosis.json", runs, out=tmp_path / "once")
    assert [run["name"] for run in once.document["confirmed_by"]] == ["fresh"]
    with pytest.raises(BadInput, match="already"):
        rm.confirm(robot, tmp_path / "once" / "diagnosis.json", runs)


@pytest.fixture(scope="module")
def limited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rover whose wheels turn no faster than 5 rad/s."""
    return diagnosed(tmp_path_factory.mktemp("limited"), LIMIT, "saturation", "dead_zone", "command_delay")


def test_a_limit_is_tested_by_what_it_predicts(limited: Path) -> None:
    """Far from a limit no derivative shows it, and one that was removed is at no number."""
    assert confirmed(limited, LIMIT, "same").outcomes == {"saturation": "agrees"}
    assert confirmed(limited, {}, "free").outcomes == {"saturation": "denies"}
    assert confirmed(limited, {}, "removed", "saturation=none").outcomes == {"saturation": "agrees"}
    assert confirmed(limited, LIMIT, "unmoved", "saturation=none").outcomes == {"saturation": "denies"}
    higher = {"saturation": {"limit": 6.0}}
    assert confirmed(limited, higher, "higher", "saturation+=1").outcomes == {"saturation": "agrees"}
    assert confirmed(limited, LIMIT, "not_higher", "saturation+=1").outcomes == {"saturation": "denies"}


def test_an_alternative_may_be_as_uncertain_as_what_it_replaces(gentle: Path, tmp_path: Path) -> None:
    """Both sizes are 40 % too small, which the interval of the diagnosed one allows: neither is excluded for it."""
    document = json.loads((gentle / "out" / "diagnosis.json").read_text())
    (effect,) = document["explanation"]
    ((name, p),) = effect["parameters"].items()
    effect["parameters"][name] = {**p, "value": 0.6 * p["value"], "ci95": [0.1 * p["value"], 1.1 * p["value"]]}
    for rows in (document["model"]["values"], document["alternatives"][0]["values"]):
        for row in rows:
            row["value"] *= 0.6
    (tmp_path / "vague.json").write_text(json.dumps(document))
    t = PERIOD * np.arange(401)
    runs = saved(driven("gentle_twice", t, gently(t + 3.0), LAG, False), gentle)
    found = rm.confirm(rm.load_robot(gentle / "robot.toml"), tmp_path / "vague.json", runs)
    assert set(found.outcomes.values()) == {"open"}
    assert not any(e["excluded"] for e in found.document["confirmation"]["explanations"])


def test_of_two_alternatives_that_remain_neither_is_confirmed(gentle: Path, tmp_path: Path) -> None:
    """The diagnosed effect is excluded, and what takes its place has a twin: the group stays, also the next time."""
    document = json.loads((gentle / "out" / "diagnosis.json").read_text())
    rows = {"effect": "actuator_lag", "target": None, "parameter": "time_constant", "value": 0.05}
    wrong = {"effect": "dead_zone", "target": None}
    entry = document["explanation"][0]
    size = {"width": {"value": 0.5, "ci95": [0.45, 0.55], "unit": "rad/s"}}
    document["explanation"] = [{**entry, **wrong, "parameters": size, "probability": 0.3}]
    document["model"]["values"] = [{**wrong, "parameter": "width", "value": 0.5}]
    delay = {**rows, "effect": "command_delay", "parameter": "delay"}
    document["alternatives"] = [
        {"effects": [{"effect": row["effect"], "target": None}], "instead_of": [wrong], "values": [row], "ratio": 0.1,
         "confounded": True}
        for row in (rows, delay)
    ]  # fmt: skip
    members = [{"effect": e, "target": None} for e in ("dead_zone", "command_delay", "actuator_lag")]
    document["confounded"] = [members]
    document["candidates"] = [{**m, "probability": 0.3, "shrink": 0.5} for m in members]
    (tmp_path / "three.json").write_text(json.dumps(document))
    robot, t = rm.load_robot(gentle / "robot.toml"), PERIOD * np.arange(401)
    runs = saved(driven("gentle_thrice", t, gently(t + 4.0), LAG, False), gentle)
    found = rm.confirm(robot, tmp_path / "three.json", runs, out=tmp_path / "first")
    kept = found.explanation[0]["effect"]
    assert kept in ONLY and found.outcomes["dead_zone"] == "denies" and found.outcomes[kept] == "open"
    assert [m["effect"] for m in found.document["confounded"][0]] == [kept, *(e for e in ONLY if e != kept)]
    (other,) = found.document["alternatives"]
    assert other["instead_of"] == [{"effect": kept, "target": None}]
    listed = {c["effect"]: c["probability"] for c in found.document["candidates"]}
    assert listed["dead_zone"] < 0.02 and sum(listed[e] for e in ONLY) == pytest.approx(0.885)
    more = saved(driven("gentle_fourth", t, gently(t + 1.0), LAG, False), gentle)
    again = rm.confirm(robot, tmp_path / "first" / "diagnosis.json", more)
    assert again.document["confounded"] == found.document["confounded"]


@pytest.mark.slow
def test_a_model_that_is_retuned_is_tested_as_well(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text('tunable = ["wheel_radius"]\n' + ROBOT)
    robot = rm.load_robot(tmp_path / "robot.toml")
    files = [write_run(rover_run(f"run{k}", LATE, seconds=12.0, seed=k), tmp_path) for k in range(2)]
    rm.diagnose(robot, rm.read_runs(robot, files), only=ONLY, out=tmp_path / "out")
    found = confirmed(tmp_path, LATE, "again", out=tmp_path / "confirmed")
    assert found.outcomes == {"command_delay": "agrees"}
    assert found.document["confirmation"]["gaps"][0]["nominal"] > 0.1


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(a) for a in arguments])
    return int(end.value.code or 0)


def test_the_command_tests_an_earlier_diagnosis(late: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new = write_run(rover_run("new", LATE, seconds=12.0, seed=11), tmp_path)
    robot, earlier = late / "robot.toml", late / "out" / "diagnosis.json"
    assert call("diagnose", "--robot", robot, "--from", earlier, "--confirm", new, "--out", tmp_path / "o") == 0
    said = capsys.readouterr().out
    assert said.startswith("The new runs confirm command delay; the diagnosed model removes") and "report:" in said
    document = json.loads((tmp_path / "o" / "diagnosis.json").read_text())
    assert document["confirmation"]["runs"] == ["new"]
    assert (tmp_path / "o" / document["run_files"][0]).resolve() == (late / "run0.csv").resolve()
    command = ("gap", "--robot", robot, new, "--model", tmp_path / "o" / "model.json", "--json")
    assert call(*command) == 0
    assert json.loads(capsys.readouterr().out)["model"] < 0.1


def test_the_command_diagnoses_and_tests_at_once(
    late: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = write_run(rover_run("new", LATE, seconds=12.0, seed=11), tmp_path)
    runs = [late / "run0.csv", late / "run1.csv"]
    command = ("diagnose", "--robot", late / "robot.toml", *runs, "--only", ",".join(ONLY), "--out", tmp_path / "o")
    assert call(*command, "--confirm", new, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["confirmation"]["effects"][0]["outcome"] == "agrees"
    page = (tmp_path / "o" / "report.html").read_text()
    assert "Test on new runs" in page and "Measured and predicted motion" in page


def test_options_that_do_not_go_together_are_refused(
    late: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, run = late / "robot.toml", late / "run0.csv"
    assert call("diagnose", "--robot", robot, "--out", tmp_path / "o") == 2
    assert call("diagnose", "--robot", robot, "--out", tmp_path / "o", "--confirm", run) == 2
    assert call("diagnose", "--robot", robot, run, "--out", tmp_path / "o", "--changed", "payload=0") == 2
    earlier = ("--from", late / "out" / "diagnosis.json", "--confirm", run, "--out", tmp_path / "o")
    for option in (("--only", "slope"), ("--horizon", "3"), ("--held-out", "run0"), ("--video", tmp_path / "x.gif")):
        assert call("diagnose", "--robot", robot, *earlier, *option) == 2
    both = ("diagnose", "--robot", robot, run, "--out", tmp_path / "o", "--confirm")
    assert call(*both, run) == 2  # before anything is diagnosed
    assert call(*both, late / "run1.csv", "--changed", "paylod=none") == 2
    assert "Traceback" not in capsys.readouterr().err and not (tmp_path / "o").exists()


def linear_fit(j: np.ndarray, found: np.ndarray) -> Fit:
    """Residuals r(x) = j (x - found), unscaled."""
    knobs = tuple(Knob("actuator_gain", f"m{i}", "gain") for i in range(len(found)))
    values = dict(zip(knobs, found.tolist(), strict=True))
    ones = np.ones(len(found))
    return Fit((), knobs, values, ones, 0.0, np.zeros((1, len(j))), j[None], np.zeros(len(found), dtype=bool))


def test_the_mismatch_is_the_least_that_both_observations_allow() -> None:
    """Against the stacked least-squares problem, with one number of which nothing is expected."""
    rng = np.random.default_rng(0)
    j, found, phi = rng.standard_normal((40, 3)), np.array([0.7, 1.1, 0.2]), 2.5
    fit = linear_fit(j, found)
    wanted = {fit.knobs[0]: Expected(0.9, 0.1), fit.knobs[2]: Expected(0.5, 0.02)}
    prior = np.array([[1 / 0.1, 0, 0], [0, 0, 1 / 0.02]])
    a = np.vstack([j / np.sqrt(phi), prior])
    b = np.concatenate([j @ found / np.sqrt(phi), [0.9 / 0.1, 0.5 / 0.02]])
    x = np.linalg.lstsq(a, b, rcond=None)[0]
    assert mismatch(fit, phi, wanted) == pytest.approx(float(np.sum((a @ x - b) ** 2)))
    assert mismatch(fit, phi, {}) == 0.0
    sigma = np.sqrt(np.diag(np.linalg.inv(j.T @ j / phi)))
    np.testing.assert_allclose(list(found_sigma(fit, phi).values()), sigma)


def test_a_number_that_the_runs_do_not_show_mismatches_nothing() -> None:
    j = np.zeros((10, 2))
    j[:, 0] = 1.0
    fit = linear_fit(j, np.array([1.0, 1.0]))
    assert mismatch(fit, 1.0, {fit.knobs[1]: Expected(5.0, 0.1)}) == pytest.approx(0.0, abs=1e-9)
    assert found_sigma(fit, 1.0)[fit.knobs[1]] == np.inf
