"""A change of a known size in recorded runs: where it is put."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import planted_change
from benchmarks.planted_change import changed
from residual_mpc.blind.recorded.half import Half, Setting
from residual_mpc.blind.recorded.inertial import inertial_of
from residual_mpc.blind.recorded.log import Column, Log
from residual_mpc.blind.recorded.mjcf import parse, place
from residual_mpc.errors import BadInput

ARM = """<mujoco><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0"/><inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .001"/>
<body name="lower" pos="0 0 -.2"><joint name="elbow" axis="0 1 0"/>
<inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .001"/><site name="tip" pos="0 0 -.3"/></body></body>
</worldbody><actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""


def half() -> Half:
    t = 0.01 * np.arange(10)
    names = ("command.m1", "command.m2", "position.shoulder", "position.elbow")
    log = Log("after_run", {name: Column(t, np.sin(t)) for name in names})
    return Half("arm", "mujoco", (log,), (Setting("*", ARM, {}),), "tip")


def test_a_longer_link_leaves_the_model_a_shorter_one() -> None:
    put = changed(half(), "link_length", "upper", 0.05, np.random.default_rng(0))
    at = place(parse(put.settings[0].model).body("lower"))
    np.testing.assert_allclose(at, [0, 0, -0.15])


def test_a_payload_that_is_lost_is_given_to_the_model() -> None:
    model = parse(changed(half(), "payload", None, -0.2, np.random.default_rng(0)).settings[0].model)
    assert inertial_of(model, model.body("lower")).mass == pytest.approx(1.2)


def test_a_friction_needs_a_joint() -> None:
    with pytest.raises(BadInput, match="coulomb_friction needs one target of shoulder, elbow, got None"):
        changed(half(), "coulomb_friction", None, 0.1, np.random.default_rng(0))


def test_a_change_of_two_numbers_needs_more_than_one_size(monkeypatch: pytest.MonkeyPatch) -> None:
    lever = SimpleNamespace(size=lambda *_: {"x": 0.1, "y": 0.0})
    monkeypatch.setattr(planted_change, "carried_by", lambda *_: ((lever, (None,)),))
    with pytest.raises(BadInput, match="sensor_mounting has more than one number: x, y"):
        changed(half(), "sensor_mounting", None, 0.1, np.random.default_rng(0))
