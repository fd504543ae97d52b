"""Rows that MuJoCo Warp steps in place of MuJoCo, on Warp's CPU device; and what is said where it cannot."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from oracles.arms import SERVOS, arm_xml, random_drive, random_start, robot_of, settings_of

from plants.mujoco_robot.simulation import compiled_steps, replay, warp_batch
from plants.mujoco_robot.simulation.warp_batch import DEVICE, WarpBatch, batch_of
from residual_mpc.errors import BadInput

TORQUES = '<motor name="j1" joint="j1" gear="2"/><motor name="j2" joint="j2"/>'
STEPS = 20
PLAIN = [{}, {("payload", None, "mass"): 0.3}, {("viscous_friction", "j1", "coefficient"): 0.5}]
STRIBECK = {("stribeck_friction", "j2", p): x for p, x in (("static", 0.2), ("kinetic", 0.1), ("velocity", 0.1))}
CHANGING = [{}, {("voltage_sag", None, "rate"): 0.3}, STRIBECK]
CART = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><geom type="plane" size="5 5 1"/>
<body name="ball" pos="0 0 0.0995"><freejoint/><geom type="sphere" size="0.1" mass="1" friction="0.8 0.01 0.001"/>
</body></worldbody></mujoco>"""


@pytest.fixture
def on_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco_warp")
    monkeypatch.setenv(DEVICE, "cpu")
    monkeypatch.setattr(replay, "native_arm", lambda robot: None)
    monkeypatch.setattr(compiled_steps, "native_arm", lambda robot: None)


def test_without_a_device_mujoco_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(DEVICE, raising=False)
    assert type(batch_of(mujoco.MjModel.from_xml_string(CART), 2, 1)) is mujoco.batch.Batch


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DEVICE, "cuda")
    monkeypatch.setitem(sys.modules, "warp", None)
    with pytest.raises(BadInput, match=r"warp is not installed"):
        batch_of(mujoco.MjModel.from_xml_string(CART), 2, 1)


def test_an_unknown_device_is_named_with_those_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco_warp")
    monkeypatch.setenv(DEVICE, "gpu7")
    with pytest.raises(BadInput, match=r"'gpu7'.*devices of Warp are cpu"):
        batch_of(mujoco.MjModel.from_xml_string(CART), 2, 1)


def test_a_model_that_warp_lacks_is_left_to_mujoco(monkeypatch: pytest.MonkeyPatch, caplog: Any) -> None:
    pytest.importorskip("mujoco_warp")
    monkeypatch.setenv(DEVICE, "cpu")
    text = CART.replace('integrator="implicitfast"', 'integrator="implicitfast" noslip_iterations="3"')
    model = mujoco.MjModel.from_xml_string(text.replace("implicitfast", "discrete"))
    assert type(batch_of(model, 2, 1)) is mujoco.batch.Batch
    assert "MuJoCo Warp cannot simulate this model" in caplog.text


@pytest.mark.slow
@pytest.mark.parametrize("actuators", [SERVOS, TORQUES], ids=["servos", "torques"])
@pytest.mark.parametrize("effects", [PLAIN, CHANGING], ids=["plain", "changing"])
def test_an_arm_moves_as_in_mujoco(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, on_warp: None, actuators: str, effects: list[Any]
) -> None:
    """To single precision: payloads, masses and frictions by row, with and without changes between the steps."""
    robot = robot_of(tmp_path, arm_xml(actuators))
    settings = settings_of(robot, *effects)
    drive, start = random_drive(robot, len(effects), STEPS), random_start(robot, len(effects))
    wanted = (*robot.channels, *(f"output.{a}" for a in robot.actuators)) if effects is CHANGING else robot.channels
    steps: list[int] = []
    rollout = WarpBatch.rollout

    def counted(self: WarpBatch, nstep: int, *rest: Any) -> Any:
        steps.append(nstep)
        return rollout(self, nstep, *rest)

    with patch.object(WarpBatch, "rollout", counted):
        by_warp = robot.replay(start, drive, settings, wanted)
    assert sum(steps) >= STEPS
    monkeypatch.delenv(DEVICE)
    by_mujoco = robot.replay(start, drive, settings, wanted)
    for channel, nodes in by_mujoco.items():
        assert np.isfinite(nodes).all()
        np.testing.assert_allclose(by_warp[channel], nodes, rtol=1e-4, atol=2e-5, err_msg=channel)
        if channel.startswith("velocity"):
            assert np.abs(by_warp[channel][:, -1] - nodes[:, -1]).max() > 1e-12  # it was not MuJoCo itself


@pytest.mark.slow
def test_rows_with_more_contacts_than_room_go_to_mujoco(on_warp: None) -> None:
    import mujoco_warp

    model, held = mujoco.MjModel.from_xml_string(CART), np.zeros((2, 5, 0))
    make = mujoco_warp.make_data
    ends = []
    for room in (16, 1):
        batch = batch_of(model, 2, 1)
        assert isinstance(batch, WarpBatch)
        batch.reset()
        batch.bind("qvel")[:, 0] = 0.5
        small = partial(make, nconmax=room, njmax=room)
        with patch.object(mujoco_warp, "make_data", small):
            ends.append(batch.rollout(5, held, warp_batch.CONTROL, ("qpos", "qvel"))["qvel"][:, -1])
    exact = mujoco.batch.Batch(model, 2, nthread=1)
    exact.reset()
    exact.bind("qvel")[:, 0] = 0.5
    there = exact.rollout(5, held, warp_batch.CONTROL, ("qpos", "qvel"))["qvel"][:, -1]
    np.testing.assert_allclose(ends[0], there, atol=1e-4)
    np.testing.assert_array_equal(ends[1], there)


@pytest.mark.slow
def test_rows_that_warp_cannot_tell_apart_have_mujocos_forces(tmp_path: Path, on_warp: None) -> None:
    """Where the rows differ in a field that Warp shares between them, MuJoCo's forces are the batch's."""
    model = robot_of(tmp_path, arm_xml(TORQUES)).model
    forces = []
    for batch in (batch_of(model, 2, 1), mujoco.batch.Batch(model, 2, nthread=1)):
        batch.expand("jnt_limited")[1] = 1
        batch.reset()
        force = batch.bind("actuator_force")
        batch.bind("ctrl")[:] = [[0.7, -0.2], [0.3, 0.1]]
        batch.step()
        forces.append(force.copy())
    assert np.abs(forces[1]).min() > 0.0
    np.testing.assert_array_equal(*forces)
