"""Ranges of forces where the robot's limit is higher than the model's."""

from __future__ import annotations

import numpy as np
import pytest

from plants.mujoco_robot.edits.force_ranges import raised, raised_by
from plants.mujoco_robot.structure.force_limits import NO_LIMIT
from residual_mpc.effects.ops import NUMPY, casadi_ops

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
def test_so_it_is_for_controllers(limit: float, times: float) -> None:
    assert float(raised_by(NUMPY, 3.0, limit)) == times
    assert float(raised_by(casadi_ops(), 3.0, limit)) == times
    assert raised_by(NUMPY, NO_LIMIT, limit) == 1.0
