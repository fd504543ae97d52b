"""`export --to servo-table`: a row a servo as CSV, with what the runs do not show."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from oracles.arms import arm_xml

from residual_mpc.cli.main import main

ACTUATORS = '<position name="s1" joint="j1" kp="30" kv="1.5"/><position name="s2" joint="j2" kp="20" kv="0.8"/>'
HIDDEN = [("actuator_gain", None, "gain", 0.8, [0.7, 0.9]), ("coulomb_friction", "j1", "torque", 0.1, [0.05, 0.15])]
ROBOT = 'name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n[motor]\nservo = "sts3215"\n'


def exported(folder: Path, name: str, *more: str) -> tuple[Any, int]:
    (folder / "arm.xml").write_text(arm_xml(ACTUATORS))
    (folder / "robot.toml").write_text(ROBOT)
    rows = [{"effect": e, "target": t, "parameter": p, "value": x} for e, t, p, x, _ in HIDDEN]
    model = {"schema": "residual-mpc/model/1", "robot": "arm", "values": rows, "robot_file": "robot.toml"}
    explanation = [
        {"effect": e, "target": t, "probability": 0.9, "parameters": {p: {"value": x, "ci95": ci, "unit": "1"}}}
        for e, t, p, x, ci in HIDDEN
    ]
    untested = [{"effect": "voltage_sag", "target": None, "why": "no run is long"}]
    found = {"schema": "residual-mpc/diagnosis/1", "robot": "arm", "explanation": explanation, "model": model}
    (folder / "diagnosis.json").write_text(json.dumps({**found, "not_testable": untested}))
    (folder / "model.json").write_text(json.dumps(model))
    with pytest.raises(SystemExit) as end:
        main(["export", str(folder / name), "--to", "servo-table", "--out", str(folder / "out"), *more])
    return folder / "out", end.value.code


def table(path: Path, key: str) -> dict[str, dict[str, str]]:
    with path.open(newline="") as file:
        return {row[key]: row for row in csv.DictReader(file)}


def test_a_diagnosis_becomes_a_row_a_servo(tmp_path: Path) -> None:
    out, code = exported(tmp_path, "diagnosis.json")
    servos = table(out / "servos.csv", "actuator")
    assert code == 0 and list(servos) == ["s1", "s2"]
    first, second = servos["s1"], servos["s2"]
    assert (first["joint"], first["servo"], first["voltage"]) == ("j1", "sts3215", "7.4")
    stated = [second[f"stiffness{k}"] for k in ("_nominal", "", "_low", "_high", "_probability", "_shown")]
    assert stated == ["20", "16", "14", "18", "0.9", "corrected"]
    assert first["dry_friction"] == "0.1" and second["dry_friction_shown"] == "not shown by these runs"
    assert first["gain_loss_shown"] == "not shown by these runs: no run is long"
    assert first["backlash"] == "0" and first["backlash_low"] == ""


def test_the_long_form_has_units(tmp_path: Path) -> None:
    out, _ = exported(tmp_path, "diagnosis.json")
    with (out / "servo_numbers.csv").open(newline="") as file:
        rows = {(r["actuator"], r["number"]): r for r in csv.DictReader(file)}
    friction = rows["s1", "dry_friction"]
    assert (friction["unit"], friction["value"], friction["effects"]) == ("N m", "0.1", "coulomb_friction")
    assert rows["s1", "stiffness"]["alike"] == "1" and friction["alike"] == "0"
    assert json.loads((out / "export.json").read_text())["servos"][0]["actuator"] == "s1"


def test_a_model_has_values_without_intervals(tmp_path: Path) -> None:
    out, code = exported(tmp_path, "model.json")
    first = table(out / "servos.csv", "actuator")["s1"]
    assert code == 0 and first["stiffness"] == "24" and first["stiffness_low"] == first["stiffness_probability"] == ""


def test_a_robot_without_servos_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = {"schema": "residual-mpc/model/1", "robot": "diff_drive", "values": []}
    (tmp_path / "rover.json").write_text(json.dumps(model))
    with pytest.raises(SystemExit) as end:
        main(["export", str(tmp_path / "rover.json"), "--to", "servo-table", "--robot", "diff_drive",
              "--out", str(tmp_path / "out")])  # fmt: skip
    assert end.value.code == 2 and "has no table of actuators" in capsys.readouterr().err
    assert not (tmp_path / "out" / "servos.csv").exists()


def test_other_choices_of_motions_widen_what_they_disagree_on(tmp_path: Path) -> None:
    exported(tmp_path, "diagnosis.json")
    others = []
    for k, gain in enumerate((0.7, 0.9)):
        found = json.loads((tmp_path / "diagnosis.json").read_text())
        found["explanation"] = found["explanation"][:1]  # the friction is not named
        found["explanation"][0]["parameters"]["gain"] |= {"value": gain, "ci95": [gain - 0.01, gain + 0.01]}
        others.append(tmp_path / f"other{k}.json")
        others[-1].write_text(json.dumps(found))
    out, code = exported(tmp_path, "diagnosis.json", "--beside", *map(str, others))
    first = table(out / "servos.csv", "actuator")["s1"]
    half = 4.302653 * 3.0 / 3**0.5  # Student's t with 2 degrees of freedom, for 24, 21 and 27 N m/rad
    pooled = [float(first[f"stiffness_across{k}"]) for k in ("", "_low", "_high")]
    assert code == 0 and pooled == pytest.approx([24.0, 24.0 - half, 24.0 + half], rel=1e-6)
    assert first["stiffness_named_in"] == "3 of 3" and first["dry_friction_named_in"] == "1 of 3"
    assert first["dry_friction_across"] == "" and first["dry_friction"] == "0.1"


def test_only_the_table_takes_other_diagnoses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exported(tmp_path, "diagnosis.json")
    with pytest.raises(SystemExit) as end:
        main(["export", str(tmp_path / "diagnosis.json"), "--to", "mjcf", "--beside", str(tmp_path / "diagnosis.json")])
    assert end.value.code == 2 and "only --to servo-table takes --beside" in capsys.readouterr().err


def test_a_model_beside_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, code = exported(tmp_path, "diagnosis.json", "--beside", str(tmp_path / "model.json"))
    assert code == 2 and "schema must be" in capsys.readouterr().err
