"""Payload and link masses against models that MuJoCo itself compiles with a geom added or moved."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import CHANNELS, arm_xml, literal, random_drive, random_start, robot_of, settings_of

from plants.mujoco_robot.edits.batch import link_direction
from plants.mujoco_robot.edits.masses import add_point_mass, parallel_axis, principal, quat_to_matrix
from plants.mujoco_robot.simulation.constants import corrected_constants

SMALL = 1e-4  # m: radius of a geom that stands for a point mass


def with_ball(mass: float, site: str = "tool", body: str = "lower") -> mujoco.MjModel:
    """The arm with a small ball of that mass at a site."""
    spec = mujoco.MjSpec.from_string(arm_xml())
    at = next(s for s in spec.sites if s.name == site).pos
    ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [SMALL, 0, 0], "pos": at, "mass": mass}
    spec.body(body).add_geom(**ball, contype=0, conaffinity=0)
    return spec.compile()


def compare(model: mujoco.MjModel, tmp_path: Path, hypothesis: dict, atol: float = 3e-7, **keys: object) -> None:
    """A replay of the robot under a hypothesis, and the literal steps of a model compiled with it."""
    robot = robot_of(tmp_path, arm_xml(), **keys)
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    came = robot.replay(start, drive, settings_of(robot, hypothesis, {}), CHANNELS)
    plain = literal(robot.model, start, drive.command[0, drive.lead :], 0)[0]
    q, v, _ = literal(model, start, drive.command[0, drive.lead :], 0)
    assert np.abs(q - plain).max() > 1e-3
    for j, joint in enumerate(("j1", "j2")):
        np.testing.assert_allclose(came[f"position.{joint}"][0], q[:, j], rtol=0, atol=atol)
        np.testing.assert_allclose(came[f"velocity.{joint}"][0], v[:, j], rtol=0, atol=50 * atol)


@pytest.mark.parametrize("mass", [0.05, 0.5, 2.0])
def test_a_payload_is_a_ball_at_the_site(tmp_path: Path, mass: float) -> None:
    compare(with_ball(mass), tmp_path, {("payload", None, "mass"): mass})


def test_a_payload_sits_at_the_site_that_the_file_names(tmp_path: Path) -> None:
    model = with_ball(0.5, site="middle")
    compare(model, tmp_path, {("payload", None, "mass"): 0.5}, payload_site="middle")


OFFSET = (0.08, -0.03, 0.05)  # m, along the axes of the site
BESIDE = {("payload", None, axis): value for axis, value in zip("xyz", OFFSET, strict=True)}
TURNED = arm_xml().replace('name="tool"', 'name="tool" euler="20 -40 70"')


def with_body_beside(xml: str, mass: float, offset: tuple[float, float, float]) -> mujoco.MjModel:
    """The arm with a body of that mass fixed beside its tool site, in a frame that has the site's pose."""
    spec = mujoco.MjSpec.from_string(xml)
    site, compiled = next(s for s in spec.sites if s.name == "tool"), spec.compile()
    mount = spec.body("lower").add_body(pos=site.pos, quat=compiled.site("tool").quat)
    ball = mount.add_body(pos=offset)
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[SMALL, 0, 0], mass=mass, contype=0, conaffinity=0)
    return spec.compile()


@pytest.mark.parametrize("xml", [arm_xml(), TURNED], ids=["straight", "turned"])
def test_a_payload_beside_the_site_is_a_body_there(tmp_path: Path, xml: str) -> None:
    robot = robot_of(tmp_path, xml)
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    hypothesis = {("payload", None, "mass"): 0.5, **BESIDE}
    came = robot.replay(start, drive, settings_of(robot, hypothesis, {}), CHANNELS)
    q, v, _ = literal(with_body_beside(xml, 0.5, OFFSET), start, drive.command[0, drive.lead :], 0)
    for j, joint in enumerate(("j1", "j2")):
        np.testing.assert_allclose(came[f"position.{joint}"][0], q[:, j], rtol=0, atol=3e-7)
        np.testing.assert_allclose(came[f"velocity.{joint}"][0], v[:, j], rtol=0, atol=1.5e-5)


def test_the_constants_of_a_payload_beside_the_site_give_the_torques_of_a_body_there(tmp_path: Path) -> None:
    """By inverse dynamics at random states, joint torques without servos and friction."""
    robot = robot_of(tmp_path, TURNED)
    new = corrected_constants(robot, settings_of(robot, {("payload", None, "mass"): 0.5, **BESIDE}))
    model, oracle = mujoco.MjModel.from_xml_string(TURNED), with_body_beside(TURNED, 0.5, OFFSET)
    for field in ("body_mass", "body_ipos", "body_inertia", "body_iquat"):
        getattr(model, field)[:] = new[field]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    rng = np.random.default_rng(0)
    for _ in range(20):
        state = rng.uniform(-1.5, 1.5, (3, 2))
        torques = []
        for m in (model, oracle):
            data = mujoco.MjData(m)
            data.qpos[:], data.qvel[:], data.qacc[:] = state
            mujoco.mj_inverse(m, data)
            torques.append(data.qfrc_inverse.copy())
        np.testing.assert_allclose(*torques, rtol=0, atol=1e-7)


def test_coordinates_of_a_payload_without_mass_change_nothing(tmp_path: Path) -> None:
    """Nor do coordinates of 0 change what its mass does, bit for bit."""
    robot = robot_of(tmp_path, TURNED)
    drive, start = random_drive(robot, 3, 50), random_start(robot, 3)
    none, mass = dict.fromkeys(BESIDE, 0.0), {("payload", None, "mass"): 0.5}
    whole = settings_of(robot, {**mass, **BESIDE}, {("payload", None, "mass"): 0.0, **BESIDE}, {**mass, **none})
    came = robot.replay(start, drive, whole, CHANNELS)
    for row, alone in ((1, {}), (2, mass)):
        wanted = robot.replay(start, drive, settings_of(robot, *[alone] * 3), CHANNELS)
        for channel in CHANNELS:
            np.testing.assert_array_equal(came[channel][row], wanted[channel][row])


def test_a_payload_is_not_far_from_its_site(tmp_path: Path) -> None:
    """At most half of the reach: 0.304 m to the second joint, and 0.202 m on to the site."""
    robot = robot_of(tmp_path, arm_xml())
    for axis in "xyz":
        low, high = robot.bounds("payload", axis, None)
        assert -low == high == pytest.approx(0.253, abs=1e-3)


def test_mass_added_to_a_link_is_a_ball_at_its_centre(tmp_path: Path) -> None:
    spec = mujoco.MjSpec.from_string(arm_xml())
    plain = spec.compile()
    at = plain.body("upper").ipos
    ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [SMALL, 0, 0], "pos": at, "mass": 0.6}
    spec.body("upper").add_geom(**ball, contype=0, conaffinity=0)
    compare(spec.compile(), tmp_path, {("link_mass", "upper", "mass"): 0.6})


def test_a_links_centre_moves_along_the_line_to_the_next_joint(tmp_path: Path) -> None:
    plain = mujoco.MjModel.from_xml_string(arm_xml())
    body = plain.body("upper").id
    along = plain.body_pos[plain.body("lower").id] / np.linalg.norm(plain.body_pos[plain.body("lower").id])
    np.testing.assert_allclose(link_direction(plain, body), along)
    plain.body_ipos[body] += 0.07 * along
    mujoco.mj_setConst(plain, mujoco.MjData(plain))
    compare(plain, tmp_path, {("link_mass", "upper", "com"): 0.07})


def test_at_the_chains_end_the_line_leads_to_the_centre_of_mass() -> None:
    model = mujoco.MjModel.from_xml_string(arm_xml())
    body = model.body("lower").id
    wanted = model.body_ipos[body] / np.linalg.norm(model.body_ipos[body])
    np.testing.assert_allclose(link_direction(model, body), wanted)


def test_a_point_mass_and_the_same_taken_away_again() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((5, 3, 3))
    inertia = root @ root.transpose(0, 2, 1) + np.eye(3)
    mass, com, added, at = (
        rng.uniform(1, 2, 5),
        rng.standard_normal((5, 3)),
        rng.uniform(0, 1, 5),
        rng.standard_normal((5, 3)),
    )
    there = add_point_mass(mass, com, inertia, added, at)
    back = add_point_mass(*there, -added, at)
    for x, y in zip(back, (mass, com, inertia), strict=True):
        np.testing.assert_allclose(x, y, atol=1e-12)


def test_a_body_of_point_masses_alone() -> None:
    """Inertia by the sum over the points, about their common centre."""
    rng = np.random.default_rng(1)
    m, r = rng.uniform(0.5, 1.5, 4), rng.standard_normal((4, 3))
    total, centre, about = m[:1], r[:1], np.zeros((1, 3, 3))
    for k in range(1, 4):
        total, centre, about = add_point_mass(total, centre, about, m[k : k + 1], r[k : k + 1])
    c = (m @ r) / m.sum()
    literal_inertia = sum(mk * ((d @ d) * np.eye(3) - np.outer(d, d)) for mk, d in zip(m, r - c, strict=True))
    np.testing.assert_allclose(centre[0], c, atol=1e-12)
    np.testing.assert_allclose(about[0], literal_inertia, atol=1e-12)
    np.testing.assert_allclose(parallel_axis(m, r - c).sum(axis=0), literal_inertia, atol=1e-12)


def test_principal_axes_rebuild_the_inertia() -> None:
    rng = np.random.default_rng(2)
    root = rng.standard_normal((6, 3, 3))
    inertia = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)
    moments, axes = principal(inertia)
    turn = quat_to_matrix(axes)
    np.testing.assert_allclose(np.linalg.det(turn), 1.0, atol=1e-12)
    np.testing.assert_allclose(turn @ (moments[:, :, None] * turn.transpose(0, 2, 1)), inertia, atol=1e-12)


def test_a_mass_may_not_become_negative(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, arm_xml())
    assert -0.8 < robot.bounds("link_mass", "mass", "upper")[0] < 0
    assert -0.4 < robot.bounds("payload", "mass", None)[0] < 0
    assert -0.01 < robot.bounds("armature", "inertia", "j1")[0] < 0


CART = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body name="cart">
<joint name="rail" type="slide" axis="1 0 0" damping="4"/><geom type="box" size="0.1 0.05 0.05" mass="5"/>
<site name="tool" pos="0 0 0.1"/></body></worldbody>
<actuator><velocity name="drive" joint="rail" kv="30"/></actuator></mujoco>"""


def test_a_payload_off_the_centre_of_a_body_on_a_slide(tmp_path: Path) -> None:
    """MuJoCo compiles a body like this as one whose centre of mass stays at its origin, unless it is told not to."""
    robot = robot_of(tmp_path, CART)
    drive, start = random_drive(robot, 2, 200), random_start(robot, 2)
    light, heavy = (
        robot.replay(start, drive, settings_of(robot, h, {}), ("position.rail",))["position.rail"][0]
        for h in ({("payload", None, "mass"): 1e-9}, {("payload", None, "mass"): 3.0})
    )
    plain = literal(robot.model, start, drive.command[0, drive.lead :], 0)[0]
    np.testing.assert_allclose(light, plain[:, 0], rtol=0, atol=3e-7)
    spec = mujoco.MjSpec.from_string(CART)
    ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [SMALL, 0, 0], "pos": [0, 0, 0.1], "mass": 3.0}
    spec.body("cart").add_geom(**ball, contype=0, conaffinity=0)
    loaded = literal(spec.compile(), start, drive.command[0, drive.lead :], 0)[0]
    np.testing.assert_allclose(heavy, loaded[:, 0], rtol=0, atol=3e-7)
    assert np.abs(loaded - plain).max() > 1e-3
