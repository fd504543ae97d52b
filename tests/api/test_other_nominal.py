"""A model that is used with another nominal robot than the one it was made with says so."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pytest
from oracles.arms import arm_xml

import residual_mpc as rm
from residual_mpc.cli.main import main
from residual_mpc.models.nominal_numbers import OtherNominal, differences, nominal_numbers

GAIN = {"effect": "actuator_gain", "target": "j1", "parameter": "gain", "value": 0.8}


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text(arm_xml())
    return tmp_path / "arm.xml"


def saved(arm: Path, folder: Path) -> Path:
    """A model.json as the program writes it, of the arm with a weaker servo."""
    given, robot = folder / "given.json", rm.load_robot(arm)
    made = {"schema": "residual-mpc/model/1", "robot": "arm", "values": [GAIN], "nominal": nominal_numbers(robot.model)}
    given.write_text(json.dumps(made))
    rm.augment(robot, diagnosis=given).save(folder / "made")
    return folder / "made" / "model.json"


def heavier(arm: Path) -> tuple[str, str]:
    """The file's first mass is doubled; (what it was, what it is)."""
    text = arm.read_text()
    was = text.split('mass="')[1].split('"')[0]
    arm.write_text(text.replace(f'mass="{was}"', f'mass="{2 * float(was)}"', 1))
    return was, str(2 * float(was))


def told(robot: Path, model: Path) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rm.augment(rm.load_robot(robot), diagnosis=model)
    return [str(w.message) for w in caught if issubclass(w.category, OtherNominal)]


def test_a_written_model_states_its_nominal_numbers_and_units(arm: Path, tmp_path: Path) -> None:
    content = json.loads(saved(arm, tmp_path).read_text())
    assert content["nominal"] == nominal_numbers(rm.load_robot(arm).model)
    assert content["nominal"]["actuator.j1.kp"] > 0.0
    assert [(v["parameter"], v["unit"]) for v in content["values"]] == [("gain", "1")]


def test_a_file_that_states_no_nominal_numbers_is_not_given_those_of_today(arm: Path, tmp_path: Path) -> None:
    given = tmp_path / "given.json"
    given.write_text(json.dumps({"schema": "residual-mpc/model/1", "robot": "arm", "values": [GAIN]}))
    rm.augment(rm.load_robot(arm), diagnosis=given).save(tmp_path / "made")
    assert json.loads((tmp_path / "made" / "model.json").read_text())["nominal"] is None
    assert told(arm, tmp_path / "made" / "model.json") == []
    rm.augment(rm.load_robot(arm)).save(tmp_path / "nominal")
    assert json.loads((tmp_path / "nominal" / "model.json").read_text())["nominal"]


def test_the_same_model_raises_no_warning(arm: Path, tmp_path: Path) -> None:
    assert told(arm, saved(arm, tmp_path)) == []


def test_a_changed_mass_is_named_with_both_values(arm: Path, tmp_path: Path) -> None:
    model = saved(arm, tmp_path)
    was, now = heavier(arm)
    said = told(arm, model)
    assert said
    assert f"mass was {float(was):g}, is {float(now):g}" in said[0]
    assert str(model) in said[0] and "more" not in said[0]


def test_saving_again_keeps_the_numbers_of_the_fit(arm: Path, tmp_path: Path) -> None:
    model = saved(arm, tmp_path)
    before = json.loads(model.read_text())["nominal"]
    heavier(arm)
    with pytest.warns(OtherNominal):
        rm.augment(rm.load_robot(arm), diagnosis=model).save(tmp_path / "again")
    assert json.loads((tmp_path / "again" / "model.json").read_text())["nominal"] == before


def test_a_number_that_is_gone_or_broken_differs(arm: Path) -> None:
    robot = rm.load_robot(arm).model
    now = nominal_numbers(robot)
    first = next(iter(now))
    content: dict[str, Any] = {"nominal": {**now, "joint.gone.damping": 1.0, first: None}}
    assert differences(content, robot) == {"joint.gone.damping": (1.0, None), first: (None, now[first])}
    assert differences({}, robot) == {}  # a file that does not state them


def test_the_command_line_warns_in_one_line(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = saved(arm, tmp_path)
    heavier(arm)
    with warnings.catch_warnings(), pytest.raises(SystemExit) as end:
        warnings.simplefilter("default")
        main(["export", str(model), "--robot", str(arm), "--to", "mjcf", "--out", str(tmp_path / "out")])
    lines = [line for line in capsys.readouterr().err.splitlines() if "nominal model" in line]
    assert end.value.code in (0, None)
    assert lines and all(line.startswith("warning: ") for line in lines)
    assert len(lines) == 1


def test_a_payload_at_another_site_is_told(arm: Path, tmp_path: Path) -> None:
    """It is held 5 cm further out; a model without a payload does not mind."""
    load = {"effect": "payload", "target": None, "parameter": "mass", "value": 0.4}
    robot = rm.load_robot(arm).model
    made = {"schema": "residual-mpc/model/1", "robot": "arm", "nominal": nominal_numbers(robot)}
    moved = arm.read_text().replace('<site name="tool" pos="', '<site name="tool" pos="0.05 ', 1)
    x = float(moved.split('<site name="tool" pos="0.05 ')[1].split()[0])
    arm.write_text(moved.replace(f'pos="0.05 {moved.split("0.05 ")[1].split()[0]}', f'pos="{x + 0.05}', 1))
    for values, warned in (([load], True), ([GAIN], False)):
        (tmp_path / "given.json").write_text(json.dumps({**made, "values": values}))
        said = told(arm, tmp_path / "given.json")
        assert bool(said) == warned
        assert not warned or "payload_site.x was" in said[0]
    older = {k: v for k, v in made["nominal"].items() if not k.startswith("payload_site.")}
    assert not differences({"values": [load], "nominal": older}, rm.load_robot(arm).model)
