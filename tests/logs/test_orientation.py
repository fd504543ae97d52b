"""A heading from a quaternion in the log."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from residual_mpc.logs.readers.orientation import as_heading

NAMES = ("pose.qx", "pose.qy", "pose.qz", "pose.qw")


def test_the_heading_is_the_yaw_of_the_rotation() -> None:
    """Also on a slope, and of quaternions of another size."""
    rng = np.random.default_rng(0)
    angles = np.stack([rng.uniform(-3.0, 3.0, 50), rng.uniform(-0.3, 0.3, 50), rng.uniform(-0.3, 0.3, 50)], axis=1)
    q = 1.7 * Rotation.from_euler("ZYX", angles).as_quat().T
    found = as_heading({**dict(zip(NAMES, q, strict=True)), "pose.x": np.ones(50)})
    assert set(found) == {"pose.theta", "pose.x"}
    np.testing.assert_allclose(found["pose.theta"], angles[:, 0], atol=1e-12)


def test_on_level_ground_two_parts_are_enough() -> None:
    found = as_heading({"pose.qz": np.sin([0.1, 0.6]), "pose.qw": np.cos([0.1, 0.6])})
    assert found["pose.theta"] == pytest.approx([0.2, 1.2])


def test_what_is_no_rotation_has_no_heading() -> None:
    parts = {name: np.array([0.0, np.nan]) for name in NAMES}
    assert np.isnan(as_heading(parts)["pose.theta"]).all()
    assert as_heading({"pose.qz": np.zeros(2)}) == {}


def test_a_logged_heading_takes_precedence() -> None:
    parts = {"pose.qz": np.array([0.5]), "pose.qw": np.array([0.5]), "pose.theta": np.array([3.0])}
    assert as_heading(parts)["pose.theta"] == [3.0]
