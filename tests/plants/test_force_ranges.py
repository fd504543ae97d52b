"""Ranges of forces where the robot's limit is higher than the model's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from oracles.arms import robot_of
from oracles.own_arms import UR5E

from plants.mujoco_robot.edits.force_ranges import raise_factor, raised
from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from residual_mpc.effects.ops import NUMPY, casadi_ops
from residual_mpc.export import Augmented, Build, augment
from residual_mpc.models.settings import Knob


def stepped(folder: Path, xml: str, values: dict[tuple[str, str, str], float]) -> Augmented:
    return augment(robot_of(folder, xml), {Knob(*k): v for k, v in values.items()}, None, Build(0.02))


RANGES = np.array([[[-3.0, 2.0], [-NO_LIMIT, NO_LIMIT], [0.0, 0.0]]] * 3)


def limited(*limits: float) -> dict[str, dict[str, np.ndarray]]:
    return {"saturation": {"limit": np.tile(np.array(limits)[:, None], (1, 3))}}


def test_a_limit_beyond_the_models_scales_its_range() -> None:
    """One below it, none, and one above it; an actuator without a limit and one that gives nothing stay as they are."""
    found = raised(RANGES, limited(2.5, np.inf, 4.5))
    np.testing.assert_array_equal(found[:, 0], [[-3.0, 2.0], [-3.0, 2.0], [-4.5, 3.0]])
    np.testing.assert_array_equal(found[:, 1:], RANGES[:, 1:])


def test_without_a_limit_nothing_changes() -> None:
    assert raised(RANGES, {}) is RANGES


@pytest.mark.parametrize(("limit", "times"), [(2.5, 1.0), (NO_LIMIT, 1.0), (4.5, 1.5)])
def test_casadi_and_numpy_raise_a_range_alike(limit: float, times: float) -> None:
    for ops in (NUMPY, casadi_ops()):
        assert float(raise_factor(ops, 3.0, limit)) == times
        assert float(raise_factor(ops, NO_LIMIT, limit)) == float(raise_factor(ops, 0.0, limit)) == 1.0


def test_a_limit_beyond_the_models_takes_its_place_in_the_step(tmp_path: Path) -> None:
    """4 N m in the model, 12 on the robot, in a motion that needs more than 4: a step is that of a model with 12."""
    weak = UR5E.replace('forcerange="-28 28"', 'forcerange="-4 4"')
    right = UR5E.replace('forcerange="-28 28"', 'forcerange="-12 12"')
    wrists = {("saturation", w, "limit"): 12.0 for w in ("wrist1", "wrist2", "wrist3")}
    models = [stepped(tmp_path, weak, {}), stepped(tmp_path, weak, wrists), stepped(tmp_path, right, {})]
    ends = []
    for model in models:
        x = model.start({"position.elbow": 1.5})
        u = model.hold(x)
        for k in range(20):
            x = model.numpy_step(x, u + 0.4 * np.sin(0.3 * k))
        ends.append(x[:12])
    assert np.abs(ends[0] - ends[1]).max() > 0.01
    np.testing.assert_allclose(ends[2], ends[1], rtol=0, atol=1e-12)
    assert [m.stepped.strengths[-1] for m in models] == [4.0, 12.0, 12.0]
