"""Inverse kinematics for the first point of a reference in tool space."""

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented

STEPS, CLOSE = 200, 1e-4  # Gauss-Newton steps, m
DAMPING = 1e-3  # m^2/rad^2


def posture_at(model: Augmented, wanted: np.ndarray) -> dict[str, float]:
    """Joint positions by channel, rad or m, near home, at which the model's outputs are `wanted` (ny,).

    Raises BadInput if the tool cannot reach the point.
    """
    at = model.stepped
    if not at.outputs:
        return dict(zip(at.poses, wanted.tolist(), strict=True))
    x, n = model.start(), len(at.poses)
    low, high = (np.array(side) for side in zip(*at.spans, strict=True))
    for _ in range(STEPS):
        e = wanted - model.outputs(x)
        if np.abs(e).max() < CLOSE:
            return dict(zip(at.poses, x[:n].tolist(), strict=True))
        nudged = np.repeat(x[None], n, axis=0)
        nudged[:, :n] += 1e-6 * np.eye(n)
        J = (model.outputs(nudged) - model.outputs(x)).T / 1e-6
        x[:n] = np.clip(x[:n] + J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(len(e)), e), low, high)
    raise BadInput(
        f"the tool comes no closer than {np.abs(e).max():.3g} m to the start of the reference", model.robot.name,
        "start the reference within the workspace, or give joint positions",
    )  # fmt: skip
