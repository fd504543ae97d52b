"""Payload and link masses against models that MuJoCo itself compiles with a geom added or moved."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import CHANNELS, arm_xml, literal, random_drive, random_start, robot_of, settings_of

from plants.mujoco_robot.edits.batch import link_direction
from plants.mujoco_robot.edits.masses import add_point_mass, parallel_axis, principal, quat_to_matrix

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
