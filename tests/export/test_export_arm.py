"""The arm's step: numpy, CasADi, C and JAX are one, the replay is the step, and MuJoCo's replay is near."""

from __future__ import annotations

import json

import numpy as np
import pytest
from oracles.arms import arm_xml

from plants.mujoco_robot import MujocoRobot
from plants.scaler_arm.dynamics.step import TASK
from plants.scaler_arm.kinematics.forward import forward_kinematics, velocity
from plants.scaler_arm.kinematics.geometry import HOME, MOTORS
from plants.scaler_arm.servo_robot import ServoArm
from residual_mpc.cli.main import main
from residual_mpc.errors import BadInput
from residual_mpc.export import Augmented, Build, augment, casadi_model
from residual_mpc.export.agreement import Agreement, Sampling, agreement, sample
from residual_mpc.export.write import write_model
from residual_mpc.learning.network.mlp import Mlp
from residual_mpc.learning.network.residual import Residual, to_json
from residual_mpc.models.load import load_robot
from residual_mpc.models.robot_file import RobotFile, read_robot_file
from residual_mpc.models.settings import Knob, Settings
from residual_mpc.models.stepping import StepOptions

SERVO = ServoArm("scaler_arm_servo")
DT = 0.01
TOGETHER = {
    Knob("command_delay", None, "delay"): 0.023,
    Knob("command_delay", "f", "delay"): 0.031,
    Knob("dead_zone", None, "width"): 0.01,
    Knob("actuator_lag", None, "time_constant"): 0.05,
    Knob("actuator_gain", "a", "gain"): 0.6,
    Knob("voltage_sag", None, "rate"): 0.02,
    Knob("viscous_friction", None, "coefficient"): 0.3,
    Knob("coulomb_friction", None, "torque"): 0.05,
    Knob("payload", None, "mass"): 0.12,
}
IN_MUJOCO = {
    Knob("link_mass", "e", "mass"): 0.1,
    Knob("link_mass", "e", "com"): 0.02,
    Knob("stribeck_friction", None, "static"): 0.2,
    Knob("stribeck_friction", None, "kinetic"): 0.1,
    Knob("load_dependent_friction", None, "coefficient"): 0.1,
}


def learned(size: float = 1.0) -> Residual:
    rng = np.random.default_rng(3)
    net = Mlp(6)
    names = tuple(f"velocity.{m}" for m in MOTORS)
    theta = 0.4 * rng.standard_normal(net.size)
    scale = size * np.full(3, 0.02)
    return Residual(net, theta, names, TASK, np.zeros(6), np.full(6, 0.5), scale, "task", DT, "scaler_arm_servo", 6.0)


def mapped(m: Augmented):
    f, p = casadi_model(m).f, m.p
    return lambda x, u: np.array(f.map(len(x))(x.T, u.T, np.tile(p[:, None], len(x)))).T


ENDLESS: dict[str, dict[Knob, float]] = {
    "saturation": {Knob("saturation", "j1", "limit"): 3.0},
    "rate_limit": {Knob("rate_limit", "j1", "rate"): 1.2},
    "torque_speed_limit": {
        Knob("torque_speed_limit", "j1", "stall_torque"): 4.0,
        Knob("torque_speed_limit", "j1", "no_load_speed"): 5.0,
    },
}


@pytest.mark.parametrize("smooth", [0.0, 0.01])
@pytest.mark.parametrize("effect", ENDLESS)
def test_what_limits_one_actuator_leaves_the_others_finite(effect, smooth, tmp_path):
    """The null of these effects is infinity, of which a smoothed minimum makes NaN, and JSON and source have none."""
    (tmp_path / "arm.xml").write_text(arm_xml())
    m = augment(load_robot(read_robot_file(tmp_path / "arm.xml")), ENDLESS[effect], None, Build(DT, smooth=smooth))
    document = write_model(m, "jax", tmp_path / "out", np.random.default_rng(0))
    assert np.isfinite(document["largest_difference"]["largest"])
    assert json.loads((tmp_path / "out" / "export.json").read_text(), parse_constant=pytest.fail) == document
    slots = {p["name"]: p for p in document["parameters"]}
    name = f"{effect}.j2.{'limit' if effect == 'saturation' else 'rate' if effect == 'rate_limit' else 'stall_torque'}"
    assert slots[name]["value"] == 1e6 and slots[name]["unit"] in ("N m", "rad/s")


@pytest.mark.parametrize("apart", [(np.nan, 0.0, 0.0), (0.0, np.nan, 0.0), (1e-17, 0.0, np.nan), (0.0, np.inf, 0.0)])
def test_an_export_that_is_not_finite_is_refused_and_leaves_nothing(tmp_path, monkeypatch, apart):
    monkeypatch.setattr("residual_mpc.export.write.agreement", lambda *_: Agreement(*apart, 1, "rad"))
    with pytest.raises(BadInput, match="not finite"):
        write_model(augment(SERVO, {}, None, Build(DT)), "jax", tmp_path, np.random.default_rng(0))
    assert list(tmp_path.iterdir()) == []


def test_the_step_is_the_replay():
    a = agreement(m := augment(SERVO, TOGETHER, None, Build(DT)), mapped(m), np.random.default_rng(0))
    assert a.step < 1e-12 and a.replay < 1e-12, a


@pytest.mark.parametrize("effects", [{}, TOGETHER, IN_MUJOCO], ids=["none", "together", "in_mujoco"])
def test_mujocos_replay_is_near(effects):
    """2.6 mrad without effects over a second's move across half the workspace: the inertia that the step has not."""
    robot = load_robot(read_robot_file("scaler_arm"))
    m = augment(robot, effects, None, Build(DT))
    a = agreement(m, mapped(m), np.random.default_rng(0), Sampling(points=50))
    assert a.step < 1e-12 and a.replay < (0.02 if effects else 0.004), a


def test_what_the_step_has_not_is_said():
    robot = load_robot(read_robot_file("scaler_arm"))
    effects = {Knob("armature", None, "inertia"): 0.01, Knob("saturation", "f", "limit"): 2.0}
    m = augment(robot, {**effects, Knob("viscous_friction", None, "coefficient"): 0.1}, None, Build(DT))
    said = {s.split(":")[0] for s in m.stepped.left_out}
    assert said == {"saturation", "armature", "viscous_friction [b]", "viscous_friction [e]"}
    structural = {"joint_compliance": "stiffness", "backlash": "gap", "link_length": "offset"}
    settings = Settings(1, {e: {p: np.full((1, 6), 0.1)} for e, p in structural.items()})
    left_out = robot.one_step(settings, StepOptions(DT)).left_out
    assert {s.split(":")[0] for s in left_out} == set(structural) and not any("not part" in s for s in left_out)
    with pytest.raises(BadInput, match="several rows|one set|lacks"):
        augment(robot, {Knob("payload", "elbow", "mass"): 1.0}, None, Build(DT))


def test_the_tool_moves_by_the_papers_equation():
    """One step by hand: FK(q + q' dt) - FK(q) plus delta of the joints' rates, and a second delta on top."""
    r = learned()
    m = augment(SERVO, {}, r, Build(DT))
    x, u = m.start(), np.array(HOME) + [0.2, -0.1, 0.1, 0.1, 0.0, 0.1]
    one = m.numpy_step(x, u)
    rates = (one[:6] - x[:6]) / DT
    wanted = velocity(x[:6], rates, DT) + r(rates)
    np.testing.assert_allclose((m.outputs(one) - m.outputs(x))[:3] / DT, wanted, atol=1e-13)
    two = m.numpy_step(one, u)
    moved = (m.outputs(two) - m.outputs(one))[:3] / DT
    again = (two[:6] - one[:6]) / DT
    np.testing.assert_allclose(moved, velocity(one[:6], again, DT) + r(again), atol=1e-13)
    assert np.abs(r(rates)).max() > 1e-3, "the network must matter, or the test says nothing"
    a = agreement(m, mapped(m), np.random.default_rng(0))
    assert a.step < 1e-12 and a.network < 1e-13


def test_the_output_is_the_tool_and_the_turn_of_the_gripper():
    m = augment(SERVO, {}, None, Build(DT))
    x = m.start({"position.wrist3": 0.1})
    tool, frame = forward_kinematics(x[:6])
    y = m.outputs(x)
    np.testing.assert_allclose(y[:3], tool, atol=1e-15)
    assert np.linalg.norm(y[3:]) == pytest.approx(np.sin(0.1), rel=1e-9)
    assert np.abs(frame @ frame.T - np.eye(3)).max() < 1e-12
    c = casadi_model(m)
    value, slope = (np.array(v) for v in c.output(x))
    np.testing.assert_allclose(value.ravel(), y, atol=1e-15)
    for j in range(m.nx):
        e = 1e-6 * np.eye(m.nx)[j]
        np.testing.assert_allclose(slope[:, j], (m.outputs(x + e) - m.outputs(x - e)) / 2e-6, atol=1e-8)


@pytest.mark.parametrize("smooth", [0.0, 1e-3])
def test_derivatives_are_exact(smooth):
    m = augment(SERVO, TOGETHER, learned(), Build(DT, smooth))
    c = casadi_model(m)
    x, u = sample(m, np.random.default_rng(2), Sampling(points=6))
    for xi, ui in zip(x, u, strict=True):
        _, a, b = (np.array(v) for v in c.stage(xi, ui, m.p))
        for j in range(m.nx + m.nu):
            e = 1e-6 * np.eye(m.nx + m.nu)[j]
            up, down = (m.numpy_step(xi + s * e[: m.nx], ui + s * e[m.nx :]) for s in (1, -1))
            np.testing.assert_allclose(np.hstack([a, b])[:, j], (up - down) / 2e-6, atol=2e-6)


def test_unknown_constants_move_the_joints():
    m = augment(SERVO, {}, None, Build(DT, disturbances=True))
    bare = augment(SERVO, {}, None, Build(DT))
    x = m.start()
    x[m.stepped.states.index("disturbance.velocity.f")] = 0.1
    apart = m.numpy_step(x, np.array(HOME))[:6] - bare.numpy_step(bare.start(), np.array(HOME))
    np.testing.assert_allclose(apart, 0.001 * np.eye(6)[2], atol=1e-15)


@pytest.mark.parametrize("to", ["casadi", "c", pytest.param("jax", marks=pytest.mark.slow)])
def test_a_written_model_is_the_source(to, tmp_path):
    document = write_model(augment(SERVO, TOGETHER, learned(), Build(DT)), to, tmp_path, np.random.default_rng(0))
    assert document["largest_difference"]["largest"] < 1e-11
    assert [o["name"] for o in document["outputs"]][:3] == ["tool.x", "tool.y", "tool.z"]
    assert document["left_out"] == []


def test_the_command_exports_a_learned_arm(tmp_path, capsys):
    """What a diagnosis of `scaler_arm` and a network in task space come to, from the file on."""
    late = {"effect": "command_delay", "target": None, "parameter": "delay", "value": 0.02}
    residual = {**to_json(learned()), "robot": "scaler_arm"}
    file = tmp_path / "model.json"
    file.write_text(
        json.dumps({"schema": "residual-mpc/model/1", "robot": "scaler_arm", "values": [late], "residual": residual})
    )
    with pytest.raises(SystemExit) as end:
        main(["export", str(file), "--to", "casadi", "--json"])
    out = capsys.readouterr().out
    assert not end.value.code, out
    document = json.loads(out)
    assert document["dt"] == DT and document["left_out"] == [] and document["largest_difference"]["step"] < 1e-12
    assert document["largest_difference"]["replay"] < 0.01
    assert "offset.task.x" in [s["name"] for s in document["states"]]


def test_without_a_network_the_step_is_the_arms_own_period(tmp_path, capsys):
    heavy = {"effect": "armature", "target": None, "parameter": "inertia", "value": 0.01}
    file = tmp_path / "model.json"
    file.write_text(json.dumps({"schema": "residual-mpc/model/1", "robot": "scaler_arm", "values": [heavy]}))
    with pytest.raises(SystemExit):
        main(["export", str(file), "--to", "casadi"])
    said = capsys.readouterr()
    assert "left out: armature" in said.err and "largest difference" in said.out
    assert json.loads((tmp_path / "export_casadi" / "export.json").read_text())["dt"] == DT


def test_a_robot_without_a_step_is_refused_with_the_reason(tmp_path):
    (tmp_path / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1" mass="1"/></body></worldbody>'
        '<actuator><motor name="m" joint="j"/></actuator></mujoco>'
    )
    own = load_robot(RobotFile("arm", "mujoco", model=tmp_path / "arm.xml"))
    robot = MujocoRobot("arm", own.model, own.payload, "motor", "link")
    with pytest.raises(BadInput, match="symbolic step"):
        augment(robot, {}, None, Build(DT))
