"""The arm as lines ends at its tool and keeps the lengths of its links."""

import numpy as np

from plants.scaler_arm.kinematics.forward import forward_kinematics
from plants.scaler_arm.kinematics.geometry import MOTORS, SCALER
from plants.scaler_arm.kinematics.skeleton import skeleton
from plants.scaler_arm.motions import CircleWithLine, references


def test_the_lines_end_at_the_tool_and_keep_their_lengths():
    q = references(CircleWithLine(), np.linspace(0.0, 4.0, 5))
    lines = skeleton(SCALER, {f"position.{m}": q[:, i] for i, m in enumerate(MOTORS)})
    np.testing.assert_allclose(lines[:, -1, 1], forward_kinematics(q)[0], atol=1e-9)
    length = np.linalg.norm(lines[:, :, 1] - lines[:, :, 0], axis=-1)
    np.testing.assert_allclose(length, np.broadcast_to(length[:1], length.shape), atol=1e-9)
