"""An arm's step in CasADi against MuJoCo: rigid bodies to rounding, moves with effects to the engine's own step."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pytest
from oracles.arms import FILTERED, MIXED, arm_xml, robot_of, settings_of
from oracles.own_arms import CROOKED, UR5E, panda
from oracles.urdfs import arm_urdf
from published.robots import panda_mjcf

from controllers.mpc import build_mpc
from controllers.usual import usual_settings
from plants.mujoco_robot import build
from plants.mujoco_robot.simulation.constants import corrected_constants
from plants.mujoco_robot.symbolic import implicit
from plants.mujoco_robot.symbolic.description import Changes, describe
from plants.mujoco_robot.symbolic.implicit import Torques, factorised, linear_step, solved, velocities
from plants.mujoco_robot.symbolic.motion import changed
from plants.mujoco_robot.symbolic.numbers import parameters
from plants.mujoco_robot.symbolic.rigid_body import mass_and_bias, tool_place
from residual_mpc.errors import BadInput
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.export.casadi_model import casadi_model
from residual_mpc.export.moving import moving_apart
from residual_mpc.learning.forms.joint import JointForm
from residual_mpc.learning.network.mlp import Mlp, initial_weights
from residual_mpc.learning.network.residual import Residual
from residual_mpc.models.actuators import Actuator
from residual_mpc.models.contract import check_robot
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.models.settings import Knob

DT = 0.02
ARMS = {"ur5e": UR5E, "panda": panda(), "crooked": CROOKED, "two": arm_xml(), "mixed": arm_xml(MIXED)}


def stepped(folder: Path, xml: str, values: dict[tuple[str, str | None, str], float] | None = None) -> Augmented:
    return augment(robot_of(folder, xml), {Knob(*k): v for k, v in (values or {}).items()}, None, Build(DT))


@pytest.mark.parametrize("name", ARMS)
def test_mass_matrix_bias_force_and_tool_are_the_engines(tmp_path: Path, name: str) -> None:
    robot = robot_of(tmp_path, ARMS[name])
    n, model = len(robot.joints), robot.model
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    body = describe(robot, Changes())
    ours = ca.Function("f", [q, v], [*mass_and_bias(body, model.opt.gravity, q, v), tool_place(body, q)[0]])
    data, rng, whole = mujoco.MjData(model), np.random.default_rng(0), np.zeros((n, n))
    for _ in range(20):
        data.qpos[:], data.qvel[:] = rng.uniform(-2, 2, n), rng.normal(0, 2, n)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, whole)
        mass, bias, tool = (np.array(x) for x in ours(data.qpos, data.qvel))
        held, at = robot.payload
        np.testing.assert_allclose(mass, whole - np.diag(model.dof_armature), atol=1e-12)
        np.testing.assert_allclose(bias.ravel(), data.qfrc_bias, atol=1e-11)
        there = data.xpos[held] + data.xmat[held].reshape(3, 3) @ at
        np.testing.assert_allclose(tool.ravel(), there, atol=1e-13)


def test_a_payload_beside_a_turned_site_is_the_engines(tmp_path: Path) -> None:
    """Mass matrix and bias force of the step's bodies, against the engine's with the corrected constants."""
    robot = robot_of(tmp_path, UR5E.replace('<site name="tool"', '<site name="tool" euler="0.4 -0.7 1.1"'))
    values = {("payload", None, k): v for k, v in {"mass": 0.8, "x": 0.05, "z": -0.08}.items()}
    settings = settings_of(robot, values)
    known = parameters(robot, settings)
    assert [(n.effect, n.parameter) for n in known.numbers if n.effect == "payload"] == [*[k[::2] for k in values]]
    n, model = len(robot.joints), robot.model
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    body = describe(robot, changed(robot, known, known.now))
    ours = ca.Function("f", [q, v], mass_and_bias(body, model.opt.gravity, q, v))
    for name, value in corrected_constants(robot, settings).items():
        getattr(model, name)[:] = value
    data, rng, whole = mujoco.MjData(model), np.random.default_rng(0), np.zeros((n, n))
    for _ in range(10):
        data.qpos[:], data.qvel[:] = rng.uniform(-2, 2, n), rng.normal(0, 2, n)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, whole)
        mass, bias = (np.array(x) for x in ours(data.qpos, data.qvel))
        np.testing.assert_allclose(mass, whole - np.diag(model.dof_armature), atol=1e-9)
        np.testing.assert_allclose(bias.ravel(), data.qfrc_bias, atol=1e-8)


def test_the_factors_solve() -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal((6, 6))
    w, b = a @ a.T + np.eye(6), rng.standard_normal(6)
    np.testing.assert_allclose(solved(factorised(w.tolist()), b.tolist()), np.linalg.solve(w, b), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "most"), [("ur5e", 2e-3), ("panda", 8e-3), ("crooked", 5e-3), ("two", 2e-3)]
)  # rad or m; the engine's own step of 2 ms is about 1e-3 off
def test_half_a_second_lies_near_the_replay(tmp_path: Path, name: str, most: float) -> None:
    assert moving_apart(stepped(tmp_path, ARMS[name]), np.random.default_rng(0)) < most


def coupled(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) kg m^2, mass matrix of a planar chain of point masses without rotors, at a posture."""
    length, mass, angle = rng.uniform(0.1, 0.5, 3), rng.uniform(0.2, 2.0, 3), np.cumsum(rng.uniform(-1.0, 1.0, 3))
    ends = np.cumsum(length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0)
    begins = np.vstack([np.zeros(2), ends[:-1]])
    out = 1e-3 * np.eye(3)
    for k in range(3):
        arms = np.where(np.arange(3)[:, None] <= k, ends[k] - begins, 0.0)
        out += mass[k] * arms @ arms.T
    return out


def test_dry_friction_of_links_that_couple_strongly(monkeypatch: pytest.MonkeyPatch) -> None:
    """The step obeys the equation of motion with friction below its level, and is what many more sweeps find, save for
    some where one joint rests and others move."""
    h, off = 0.01, []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        mass, level, torque = coupled(rng), rng.uniform(0.05, 3.0, 3), rng.normal(0.0, 3.0, 3)
        v = rng.normal(0.0, 1.0, 3) * (rng.uniform(size=3) < 0.7)
        step = linear_step(mass, np.zeros(3), Torques(torque, np.zeros(3), np.zeros(3), level), v, h)
        new, friction = (np.array(x) for x in velocities(step, level, v, h, within))
        np.testing.assert_allclose(mass @ (new - v), h * (torque - friction), atol=1e-9)
        assert (np.abs(friction) <= level + 1e-12).all()
        with monkeypatch.context() as patch:
            patch.setattr(implicit, "SWEEPS", 3000)
            off.append(np.abs(new - velocities(step, level, v, h, within)[0]).max())
    assert np.quantile(off, 0.8) < 1e-6 and np.max(off) < 0.3  # rad/s


def within(x: float, most: float) -> float:
    return float(np.clip(x, -most, most))


@pytest.mark.slow
def test_a_gripper_that_nobody_commands_is_rigid_in_the_step(tmp_path: Path) -> None:
    """Two coupled fingers on a tendon: a step for the arm alone, near the replay in which the fingers may move."""
    model = stepped(tmp_path, panda_mjcf(), {("coulomb_friction", "joint2", "torque"): 2.0})
    joints = [f"joint{k}" for k in range(1, 8)]
    assert model.stepped.states[:7] == tuple(f"position.{j}" for j in joints)
    fixed = "fixed in the step, at the model's reference configuration (qpos0)"
    assert f"joints finger_joint1, finger_joint2: {fixed}" in model.stepped.left_out
    assert moving_apart(model, np.random.default_rng(0)) < 8e-3
    check_robot(robot_of(tmp_path, panda_mjcf()), np.random.default_rng(0), size=0.1)


def test_a_held_joint_is_rigid_in_the_step(tmp_path: Path) -> None:
    """A controller that tracked it would throw the others about; without effects and with one on each joint."""
    for values in ({}, {("coulomb_friction", "j1", "torque"): 0.2, ("coulomb_friction", "j2", "torque"): 0.1}):
        robot = robot_of(tmp_path, arm_xml(), held=("j2",))
        model = augment(robot, {Knob(*k): v for k, v in values.items()}, None, Build(DT))
        assert model.stepped.states[:2] == ("position.j1", "velocity.j1") and model.stepped.commands == ("j1",)
        assert "joint j2: fixed in the step, at the model's reference configuration (qpos0)" in model.stepped.left_out
        assert moving_apart(model, np.random.default_rng(0)) < 2e-3


@pytest.mark.parametrize("urdf", [True, False])
def test_the_usual_controller_of_a_robot_with_a_held_joint_tracks_the_others(tmp_path: Path, urdf: bool) -> None:
    """In a URDF it stays in the step, and counts for next to nothing there."""
    if urdf:
        path = tmp_path / "arm.urdf"
        path.write_text(arm_urdf(("j1", "j2"), -3.0, 3.0))
        servos = {j: Actuator("position", 80.0, 4.0) for j in ("j1", "j2")}
        robot = build(RobotFile("arm", "mujoco", model=path, actuators=servos, held=("j2",)))
    else:
        robot = robot_of(tmp_path, arm_xml(), held=("j2",))
    model = augment(robot, {}, None, Build(DT))
    assert ("position.j2" in model.stepped.poses) == urdf
    settings = usual_settings(model)
    mpc = build_mpc(model, settings)
    x, state = model.start({"position.j1": 0.0}), mpc.init()
    for _ in range(80):
        command, state, _ = mpc.step(state, x, np.tile([0.3, 0.5][: 1 + urdf], (settings.horizon, 1)))
        x = model.numpy_step(x, command)
    assert x[0] == pytest.approx(0.3, abs=5e-3)


def test_a_coupling_of_a_driven_joint_is_refused(tmp_path: Path) -> None:
    coupled = panda_mjcf().replace('joint1="finger_joint1" joint2="finger_joint2"', 'joint1="joint6" joint2="joint7"')
    assert coupled != panda_mjcf()
    with pytest.raises(BadInput, match="equality constraints"):
        stepped(tmp_path, coupled)


EFFECTS = [
    {("command_delay", None, "delay"): 0.037},
    {("actuator_lag", "elbow", "time_constant"): 0.05},
    {("actuator_gain", None, "gain"): 0.7},
    {("voltage_sag", None, "rate"): 0.2},
    {("saturation", "elbow", "limit"): 35.0},
    {("dead_zone", None, "width"): 0.02},
    {("coulomb_friction", "shoulder_lift", "torque"): 10.0},
    {("viscous_friction", None, "coefficient"): 20.0},
    {("viscous_friction", "elbow", "coefficient"): -150.0},  # of 400 that its servo has
    {("viscous_friction", "elbow", "coefficient"): -150.0, ("actuator_gain", "elbow", "gain"): 0.8},
    {("stribeck_friction", "elbow", "static"): 8.0, ("stribeck_friction", "elbow", "kinetic"): 4.0},
    {("load_dependent_friction", None, "coefficient"): 0.2},
    {("load_dependent_friction", None, k): v for k, v in {"coefficient": 0.1, "quadratic": 0.0004}.items()},
    {("payload", None, "mass"): 0.8},
    {("payload", None, k): v for k, v in {"mass": 0.8, "x": 0.05, "y": 0.1, "z": -0.08}.items()},
    {("link_mass", "forearm", "mass"): 2.0, ("link_mass", "forearm", "com"): 0.05},
    {("armature", None, "inertia"): 0.5},
    {("link_length", "upper_arm", "offset"): 0.1},
    {("joint_spring", "elbow", "stiffness"): 30.0, ("joint_spring", "elbow", "rest"): 0.3},
    {("torque_offset", "shoulder_lift", "torque"): 8.0},
    {("base_tilt", None, "roll"): 0.1, ("base_tilt", None, "pitch"): -0.2},
    {("gravity_compensation", None, "share"): 0.9},
    {("gravity_compensation", None, "share"): 0.9, ("payload", None, "mass"): 0.8, ("base_tilt", None, "roll"): 0.1},
    {("torque_speed_limit", "elbow", "stall_torque"): 30.0, ("torque_speed_limit", "elbow", "no_load_speed"): 2.0},
    {("rate_limit", "elbow", "rate"): 0.5},
    {
        ("torque_ripple", "elbow", name): value
        for name, value in {"amplitude": 8.0, "cycles": 7.5, "phase": 0.3, "lead": 0.02}.items()
    },
    {("servo_integral", "shoulder_lift", "gain"): 3.0},
    {("position_gain", "shoulder_lift", "gain"): 0.6},
    {("position_gain", None, "gain"): 1.5, ("actuator_gain", "elbow", "gain"): 0.8},
    {("gear_efficiency", "shoulder_lift", "forward"): 0.7, ("gear_efficiency", "shoulder_lift", "backward"): 0.8},
]


@pytest.mark.parametrize("values", EFFECTS, ids=lambda v: next(iter(v))[0])
def test_an_effect_acts_as_in_the_replay(tmp_path: Path, values: dict) -> None:
    """The step and the replay of one model with the effect differ little (that it acts at all is tested below)."""
    model = stepped(tmp_path, UR5E, values)
    assert not model.stepped.left_out[1:]
    most = 5e-3 if ("rate_limit", "elbow", "rate") in values else 3e-3  # a ramp in steps of 20 ms
    assert moving_apart(model, np.random.default_rng(1)) < most


@pytest.mark.parametrize("values", EFFECTS, ids=lambda v: next(iter(v))[0])
def test_an_effect_moves_the_step(tmp_path: Path, values: dict) -> None:
    plain, changed = stepped(tmp_path, UR5E), stepped(tmp_path, UR5E, values)
    ends = []
    for model in (plain, changed):
        x = model.start({"position.shoulder_lift": -1.2, "position.elbow": 1.5})
        u = plain.hold(plain.start({"position.shoulder_lift": -1.2, "position.elbow": 1.5}))
        for k in range(20):
            x = model.numpy_step(x, u + 0.4 * np.sin(0.3 * k))
        ends.append(x[:6])
    assert np.abs(ends[0] - ends[1]).max() > 2e-4


def test_a_stiff_servo_is_stable_at_twenty_milliseconds(tmp_path: Path) -> None:
    """kp 2e5 and hardly any damping: an explicit step of 20 ms would multiply an error by hundreds."""
    stiff = arm_xml('<position name="j1" joint="j1" kp="2e5" kv="1"/><position name="j2" joint="j2" kp="2e5" kv="1"/>')
    model = stepped(tmp_path, stiff)
    x = model.start()
    for _ in range(100):
        x = model.numpy_step(x, np.array([0.4, -0.3]))
    np.testing.assert_allclose(x[:2], [0.4, -0.3], atol=1e-3)
    assert np.abs(x[2:4]).max() < 1e-6


def test_a_joint_that_rubs_sticks(tmp_path: Path) -> None:
    """A horizontal pendulum stays in place under its dry friction, and falls without it."""
    free = '<motor name="j1" joint="j1"/><motor name="j2" joint="j2"/>'
    ends = []
    for torque in (8.0, 0.0):
        model = stepped(tmp_path, arm_xml(free), {("coulomb_friction", None, "torque"): torque})
        x = model.start()
        for _ in range(10):
            x = model.numpy_step(x, np.zeros(2))
        ends.append(np.abs(x[:2] - model.start()[:2]).max())
    assert ends[0] < 1e-9 and ends[1] > 0.05


@pytest.mark.parametrize("name", ["ur5e", "crooked", "mixed"])
def test_the_commands_that_hold_leave_the_arm_where_it_is(tmp_path: Path, name: str) -> None:
    model = stepped(tmp_path, ARMS[name])
    x = at = model.start()
    u = model.hold(x)
    for _ in range(10):
        x = model.numpy_step(x, u)
    np.testing.assert_allclose(x, at, atol=1e-6)


def test_casadi_gives_the_numpy_step_and_its_derivatives(tmp_path: Path) -> None:
    values = {("command_delay", None, "delay"): 0.03, ("payload", None, "mass"): 0.5}
    model = stepped(tmp_path, CROOKED, values)
    c, rng = casadi_model(model), np.random.default_rng(0)
    x = model.start() + 0.1 * rng.standard_normal(model.nx)
    u = model.hold(x) + 0.1 * rng.standard_normal(model.nu)
    new, a, b = (np.array(y) for y in c.stage(x, u, c.p0))
    np.testing.assert_allclose(new.ravel(), model.numpy_step(x, u), atol=1e-12)
    for matrix, at, count in ((a, 0, model.nx), (b, 1, model.nu)):
        for i, e in enumerate(1e-6 * np.eye(count)):
            one, other = (model.numpy_step(*((x + s * e, u) if at == 0 else (x, u + s * e))) for s in (1, -1))
            np.testing.assert_allclose(matrix[:, i], (one - other) / 2e-6, atol=2e-5)


def test_parameters_are_arguments(tmp_path: Path) -> None:
    heavy, light = (stepped(tmp_path, UR5E, {("payload", None, "mass"): m}) for m in (1.0, 0.2))
    f = casadi_model(light).f
    x, u = light.start(), light.hold(light.start())
    np.testing.assert_allclose(np.array(f(x, u, heavy.p)).ravel(), heavy.numpy_step(x, u), atol=1e-12)


def test_null_effects_change_nothing(tmp_path: Path) -> None:
    plain = stepped(tmp_path, UR5E)
    nothing = stepped(tmp_path, UR5E, {("payload", None, "mass"): 0.0, ("actuator_gain", None, "gain"): 1.0})
    x, u = plain.start(), plain.hold(plain.start()) + 0.1
    np.testing.assert_array_equal(plain.numpy_step(x, u), nothing.numpy_step(x, u))


@pytest.mark.slow
def test_the_arm_keeps_the_contract(tmp_path: Path) -> None:
    check_robot(robot_of(tmp_path, CROOKED), np.random.default_rng(0), size=0.1)


REFUSED = {
    "dynamics or a delay of its own": arm_xml(FILTERED),
    "tendons that exert forces": arm_xml().replace(
        "<actuator>",
        '<tendon><fixed stiffness="5"><joint joint="j1" coef="1"/><joint joint="j2" coef="1"/></fixed></tendon>'
        "<actuator>",
    ),
    "equality constraints": arm_xml().replace(
        "<actuator>", '<equality><joint joint1="j1" joint2="j2"/></equality><actuator>'
    ),
    "gravcomp": arm_xml().replace('<body name="lower"', '<body name="lower" gravcomp="1"'),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_the_step_cannot_express_is_refused_with_the_reason(tmp_path: Path, why: str) -> None:
    with pytest.raises(BadInput, match=why):
        stepped(tmp_path, REFUSED[why])


def test_what_has_no_place_in_the_step_is_listed(tmp_path: Path) -> None:
    model = stepped(tmp_path, UR5E, {("joint_compliance", "elbow", "stiffness"): 900.0})
    assert any("joint_compliance" in line for line in model.stepped.left_out)


def test_a_network_on_the_accelerations_acts_as_in_the_replay(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    form, rng = JointForm(), np.random.default_rng(0)
    inputs, outputs = form.inputs(robot), form.outputs(robot)
    net = Mlp(len(inputs), outputs=len(outputs))
    theta = initial_weights(net, rng) + 0.3 * rng.standard_normal(net.size)
    sizes = np.zeros(len(inputs)), np.ones(len(inputs)), np.full(len(outputs), 5.0)
    network = Residual(net, theta, inputs, outputs, *sizes, "joint", DT, "robot", 3.0)
    plain, learned = (augment(robot, {}, r, Build(DT)) for r in (None, network))
    assert moving_apart(learned, np.random.default_rng(0)) < 3e-3
    x, u = plain.start(), plain.hold(plain.start())
    assert np.abs(plain.numpy_step(x, u) - learned.numpy_step(x, u))[2:].max() > 0.005
    c = casadi_model(learned)
    np.testing.assert_allclose(np.array(c.f(x, u, c.p0)).ravel(), learned.numpy_step(x, u), atol=1e-12)
