"""Pictures of MuJoCo robots: skeleton and rendered shape are where the robot is, and say when they cannot be."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of
from published.robots import panda_mjcf, rover_mjcf

from plants.mujoco_robot import MujocoRobot, build
from plants.mujoco_robot.drawing import renderer, worker
from residual_mpc.models.drawing import Camera, NoRenderer
from residual_mpc.models.robot_file import RobotFile
from residual_mpc.report.motion.film import SIZE, draw
from residual_mpc.report.motion.ghosts import Ghosts
from residual_mpc.report.motion.side_view import limbs, side_view

SMALL = (120, 90)  # px


@pytest.fixture
def arm(tmp_path: Path) -> MujocoRobot:
    return robot_of(tmp_path, arm_xml())


def swing(robot: MujocoRobot, size: float, frames: int = 3) -> dict[str, np.ndarray]:
    return {s.position: size * np.linspace(0.5, 1.0, frames) for s in robot.states}


def without_renderer(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise NoRenderer("no renderer was found (tried egl and osmesa)")

    monkeypatch.setattr(renderer, "_backend", none)


def with_renderer() -> None:
    try:
        renderer._backend()
    except NoRenderer as none:
        pytest.skip(str(none))


def test_the_skeleton_ends_at_the_payload_site(arm: MujocoRobot) -> None:
    motion = swing(arm, 0.8)
    bones = arm.skeleton(motion)
    data = mujoco.MjData(arm.model)
    for k in range(3):
        for joint in ("j1", "j2"):
            data.joint(joint).qpos[0] = motion[f"position.{joint}"][k]
        mujoco.mj_forward(arm.model, data)
        np.testing.assert_allclose(bones[k, -1, 1], data.site("tool").xpos, atol=1e-12)
        np.testing.assert_allclose(bones[k, 1], [data.body("upper").xpos, data.body("lower").xpos], atol=1e-12)


def test_the_camera_of_the_report_is_that_of_the_renderer(arm: MujocoRobot) -> None:
    with_renderer()
    motion = swing(arm, 0.6, 1)
    camera = Camera((0.2, 0.0, 1.0), 60.0, -15.0, 1.0)
    (shade,) = arm.shade([motion], camera, SMALL)
    rows, columns = np.nonzero(shade[0])
    seen = camera.project(arm.skeleton(motion)[0].reshape(-1, 3), SMALL)
    reach = 0.05 / camera.height * SMALL[1]  # px: no shape of this arm is thicker, m
    assert shade[0].max() > 150 and abs(columns.max() - seen[1:, 0].max()) < reach + 1
    assert abs(rows.max() - seen[1:, 1].max()) < reach + 1
    for x, y in camera.project(0.5 * (arm.skeleton(motion)[0, 1, 0] + arm.skeleton(motion)[0, 1, 1])[None], SMALL):
        assert shade[0, round(y), round(x)] > 0


def test_a_model_without_shapes_is_rendered_by_its_skeleton(tmp_path: Path) -> None:
    with_renderer()
    (tmp_path / "panda.xml").write_text(panda_mjcf())
    panda = build(RobotFile("panda", "mujoco", model=tmp_path / "panda.xml"))
    assert panda.model.ngeom == 0
    motion = {c: np.array([x]) for c, x in panda.rest.items()} | {"position.joint4": np.array([-1.5])}
    bones = panda.skeleton(motion)
    camera = side_view(bones[None], SMALL)
    shades = panda.shade([motion], camera, SMALL)[0, 0], limbs(bones[None], camera, SMALL)[0, 0]
    together, either = shades[0].astype(bool) & shades[1].astype(bool), shades[0].astype(bool) | shades[1].astype(bool)
    assert together.sum() > 0.8 * either.sum() > 100


def test_without_a_renderer_the_skeleton_is_drawn_and_the_report_says_so(
    arm: MujocoRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_renderer(monkeypatch)
    some = [swing(arm, size) for size in (0.5, 0.9, 0.6)]
    drawn = draw(arm, Ghosts(some[0], some[1], some[2], (), 1.0))
    assert drawn is not None
    frames, _, how = drawn
    assert how == "Drawn as a skeleton: no renderer was found (tried egl and osmesa)."
    assert frames.shape[0] == 3 and (frames[-1] < 100).all(axis=-1).sum() > 1000 and frames.shape[2] == SIZE[0]


def test_a_renderer_that_fails_is_said(arm: MujocoRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renderer, "_backend", lambda: "egl")
    broken = Camera((0.0, 0.0, 0.0), 0.0, 0.0, 1.0)
    with pytest.raises(NoRenderer, match="the renderer failed"):
        arm.shade([swing(arm, 0.5)], broken, (0, -1))


def test_the_ground_is_not_part_of_the_robot() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><body><joint name="j"/><geom size="0.1"/></body>'
        "</worldbody></mujoco>"
    )
    assert not worker.prepare(model)
    assert model.geom_rgba[:, 3].tolist() == [0.0, 1.0]


def test_a_shape_that_hangs_in_the_air_gets_a_limb_to_its_joint() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="j"/><geom size="0.02" pos="0 0 -0.1"/></body></worldbody></mujoco>'
    )
    assert worker.prepare(model)


def test_a_driving_robot_is_as_wide_as_its_wheels_stand(tmp_path: Path) -> None:
    (tmp_path / "rover.xml").write_text(rover_mjcf())
    rover = build(RobotFile("rover", "mujoco", model=tmp_path / "rover.xml", pose_body="base_link"))
    outline = rover.outline
    assert outline is not None
    assert np.ptp(outline[:, 1]) == pytest.approx(0.3756 + 2 * 0.03, abs=0.01)  # wheel centres and half their widths
    assert outline[:, 0].min() == pytest.approx(-0.262 / 2 - 0.098, abs=0.01)
