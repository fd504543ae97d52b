"""Parameter sets for mujoco.sysid and tables of actuators say what was diagnosed, and what they leave out."""

from __future__ import annotations

import importlib.util
import json
import tomllib
from dataclasses import fields, make_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml

from residual_mpc.cli.main import main

SERVOS = '<position name="s1" joint="j1" kp="30" kv="1.5" gear="2"/><position name="s2" joint="j2" kp="20" kv="0.8"/>'
Value = tuple[float, float, float]  # and its interval
HIDDEN: dict[tuple[str, str | None, str], Value] = {
    ("command_delay", None, "delay"): (0.04, 0.038, 0.043),
    ("coulomb_friction", "j1", "torque"): (0.3, 0.2, 0.4),
    ("viscous_friction", None, "coefficient"): (0.2, 0.15, 0.25),
    ("armature", "j2", "inertia"): (0.02, 0.01, 0.03),
    ("actuator_gain", "s2", "gain"): (0.8, 0.7, 0.9),
    ("position_gain", "s1", "gain"): (1.3, 1.2, 1.4),
    ("payload", None, "mass"): (0.25, 0.2, 0.3),
    ("link_length", "upper", "offset"): (0.03, 0.02, 0.04),
    ("saturation", "s1", "limit"): (4.0, 3.0, 5.0),
}
ISAAC = {  # fields of isaaclab.actuators: ActuatorBaseCfg and DelayedPDActuatorCfg
    "joint_names_expr", "effort_limit", "velocity_limit", "effort_limit_sim", "velocity_limit_sim", "stiffness",
    "damping", "armature", "friction", "dynamic_friction", "viscous_friction", "min_delay", "max_delay",
}  # fmt: skip


def exported(
    folder: Path, to: str, hidden: dict[tuple[str, str | None, str], Value], *more: str, actuators: str = SERVOS
) -> dict[str, Any]:
    (folder / "arm.xml").write_text(arm_xml(actuators))
    (folder / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    explanation: dict[tuple[str, str | None], dict[str, Any]] = {}
    for (e, t, p), (x, low, high) in hidden.items():
        member = explanation.setdefault((e, t), {"effect": e, "target": t, "parameters": {}})
        member["parameters"][p] = {"value": x, "ci95": [low, high]}
    rows = [{"effect": e, "target": t, "parameter": p, "value": x[0]} for (e, t, p), x in hidden.items()]
    model = {"schema": "residual-mpc/model/1", "robot": "arm", "values": rows, "robot_file": "robot.toml"}
    document = {"schema": "residual-mpc/diagnosis/1", "robot": "arm", "explanation": [*explanation.values()]}
    (folder / "diagnosis.json").write_text(json.dumps({**document, "model": model}))
    with pytest.raises(SystemExit) as end:
        main(["export", str(folder / "diagnosis.json"), "--to", to, "--out", str(folder / "out"), *more])
    assert end.value.code == 0
    return json.loads((folder / "out" / "export.json").read_text())


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


class Parameter:
    """What a modifier of mujoco.sysid is given."""

    def __init__(self, value: float) -> None:
        self.value = np.array([value])


@pytest.mark.parametrize("key", list(HIDDEN), ids=lambda k: k[0])
def test_a_parameter_moves_the_model_as_its_effect_does(tmp_path: Path, key: tuple[str, str | None, str]) -> None:
    document = exported(tmp_path, "sysid", {key: HIDDEN[key]})
    assert document["largest_difference"]["largest"] < 2e-6 and document["left_out"] == []
    (parameter,) = document["parameters"]
    assert (parameter["value"], *parameter["bounds"]) == HIDDEN[key]
    made = module(tmp_path / "out" / "sysid_parameters.py")
    (_, value, low, high, edits) = made.PARAMETERS[0]
    spec = made.nominal()
    made._modifier(edits)(spec, Parameter(low))
    other = exported(tmp_path, "sysid", {key: (low, low, high)})  # the same, had its lower end been diagnosed
    assert other["largest_difference"]["largest"] < 2e-6
    twin = made.nominal()
    mine, theirs = spec.compile(), twin.compile()
    for name in ("body_mass", "body_pos", "dof_damping", "dof_armature", "dof_frictionloss", "actuator_gainprm",
                 "actuator_biasprm", "actuator_forcerange", "actuator_delay"):  # fmt: skip
        np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), rtol=1e-6, atol=1e-12, err_msg=name)


def test_a_payloads_mass_is_a_parameter_where_its_centre_was_found(tmp_path: Path) -> None:
    beside = {("payload", None, k): v for k, v in (("x", (0.06, 0.05, 0.07)), ("z", (-0.02, -0.03, -0.01)))}
    document = exported(tmp_path, "sysid", {("payload", None, "mass"): (0.25, 0.2, 0.3), **beside})
    assert document["largest_difference"]["from_all_effects"] < 2e-6 and document["left_out"] == []
    assert [p["name"] for p in document["parameters"]] == ["payload.mass"]


def test_all_parameters_together_in_the_toolbox(tmp_path: Path) -> None:
    document = exported(tmp_path, "sysid", HIDDEN | {("backlash", "j1", "gap"): (0.03, 0.02, 0.04)})
    assert document["largest_difference"]["largest"] < 2e-6 < 1e-3 < document["largest_difference"]["from_all_effects"]
    assert len(document["parameters"]) == len(HIDDEN) and "backlash" in document["left_out"][0]
    made = module(tmp_path / "out" / "sysid_parameters.py")
    assert "backlash" in (made.__doc__ or "")
    sysid = pytest.importorskip("mujoco.sysid")
    if not hasattr(sysid, "ParameterDict"):
        pytest.skip("mujoco[sysid] is not installed")
    parameters, spec = made.parameters(), made.nominal()
    low, high = parameters.get_bounds()
    assert (
        parameters.size == len(HIDDEN)
        and (low <= parameters.as_vector()).all()
        and (parameters.as_vector() <= high).all()
    )
    before = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "nominal.xml"))
    after = sysid.apply_param_modifiers(parameters, spec)
    np.testing.assert_allclose(after.body_mass, before.body_mass, rtol=1e-6)
    parameters["payload.mass"].value = np.array([0.3])
    assert sysid.apply_param_modifiers(parameters, spec).body_mass.sum() == pytest.approx(before.body_mass.sum() + 0.05)


def test_two_effects_on_one_number_are_not_both_free(tmp_path: Path) -> None:
    twice = {
        ("viscous_friction", None, "coefficient"): (0.2, 0.1, 0.3),
        ("viscous_friction", "j1", "coefficient"): (0.5, 0.4, 0.6),
    }
    document = exported(tmp_path, "sysid", twice)
    assert len(document["parameters"]) == 1 and "changes the same numbers" in document["left_out"][0]


def test_a_model_without_intervals_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exported(tmp_path, "actuators", HIDDEN)
    model = json.loads((tmp_path / "diagnosis.json").read_text())["model"]
    (tmp_path / "model.json").write_text(json.dumps(model))
    with pytest.raises(SystemExit) as end:
        main(["export", str(tmp_path / "model.json"), "--to", "sysid", "--out", str(tmp_path / "new")])
    assert end.value.code == 2 and "states no intervals" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_actuators_by_joint(tmp_path: Path) -> None:
    document = exported(tmp_path, "actuators", HIDDEN, "--dt", "0.005")
    text = (tmp_path / "out" / "actuators.toml").read_text()
    table = tomllib.loads(text)
    one, two = table["joint"]["j1"], table["joint"]["j2"]
    assert (one["stiffness"], one["damping"], one["gear"]) == (156.0, 6.0, 2.0)  # 1.3 times, by the gear's square
    assert (two["stiffness"], two["damping"]) == (pytest.approx(16.0), pytest.approx(0.64))  # weakened to 0.8
    assert (one["effort_limit"], one["friction"], one["armature"]) == (8.0, pytest.approx(0.3), 0.01)
    assert "effort_limit" not in two and (two["friction"], two["armature"]) == (0.02, pytest.approx(0.025))
    assert (one["viscous_friction"], two["viscous_friction"]) == (pytest.approx(0.3), pytest.approx(0.25))
    assert two["ci95"]["stiffness"] == pytest.approx([14.0, 18.0]) and one["ci95"]["delay"] == [0.038, 0.043]
    assert {line.split(":")[0] for line in document["left_out"]} == {"payload", "link_length"}
    assert all(what in text for what in document["left_out"])


def test_what_a_command_of_a_geared_actuator_is(tmp_path: Path) -> None:
    driven = '<motor name="m1" joint="j1" gear="24" ctrlrange="-1 1"/><velocity name="v2" joint="j2" kv="2" gear="3"/>'
    document = exported(tmp_path, "actuators", {}, actuators=driven)
    assert document["approximated"] == [
        "m1: a command of 1 gives 24 N m at the joint (N where it slides)",
        "v2: its command is 3 times the joint's velocity",
    ]
    text = (tmp_path / "out" / "actuators.toml").read_text()
    assert "stiffness = 0.0\n" in text and "-0.0" not in text


def test_the_groups_are_keywords_of_isaac_lab(tmp_path: Path) -> None:
    exported(tmp_path, "actuators", HIDDEN, "--dt", "0.005")
    table = tomllib.loads((tmp_path / "out" / "actuators.toml").read_text())
    (group,) = table["isaac_lab"].values()
    assert group["class"] == "DelayedPDActuatorCfg"
    cfg = make_dataclass(group["class"], [(name, Any, None) for name in sorted(ISAAC)])
    made = cfg(**group["keywords"])
    assert {f.name for f in fields(made)} == ISAAC
    assert made.joint_names_expr == ["j1", "j2"] and (made.min_delay, made.max_delay) == (7, 9)
    assert made.effort_limit == {"j1": 8.0} and made.friction == made.dynamic_friction
    assert table["newton"]["joint_target_ke"] == {"j1": 156.0, "j2": pytest.approx(16.0)}
    assert table["newton"]["delay_steps"] == {"j1": 8, "j2": 8}
    assert set(table["newton"]) == {
        "joint_target_ke", "joint_target_kd", "joint_damping", "joint_armature", "joint_friction", "joint_effort_limit",
        "delay_steps",
    }  # fmt: skip


def test_without_a_delay_the_physics_engine_is_the_servo(tmp_path: Path) -> None:
    lag = {("actuator_lag", "s1", "time_constant"): (0.05, 0.04, 0.06)}
    document = exported(tmp_path, "actuators", lag)
    table = tomllib.loads((tmp_path / "out" / "actuators.toml").read_text())
    assert [g["class"] for g in table["isaac_lab"].values()] == ["ImplicitActuatorCfg"] and table["physics_dt"] == 0.002
    assert table["joint"]["j1"]["lag"] == 0.05 and any("filter of 0.05 s" in note for note in document["approximated"])


def test_a_rover_has_no_actuators_to_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = {"schema": "residual-mpc/model/1", "robot": "diff_drive", "values": []}
    (tmp_path / "model.json").write_text(json.dumps(model))
    for to in ("actuators", "sysid", "urdf"):
        with pytest.raises(SystemExit) as end:
            main(["export", str(tmp_path / "model.json"), "--to", to, "--robot", "diff_drive"])
        assert end.value.code == 2 and f"--to {to}" in capsys.readouterr().err
