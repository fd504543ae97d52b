"""Inverse kinematics of references in tool space."""

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
    q, off = closest(model, wanted, np.array(model.start()[: len(at.poses)]))
    if off < CLOSE:
        return dict(zip(at.poses, q.tolist(), strict=True))
    raise BadInput(
        f"the tool comes no closer than {off:.3g} m to the start of the reference", model.robot.name,
        "start the reference within the workspace, or give joint positions",
    )  # fmt: skip


def closest(model: Augmented, wanted: np.ndarray, begin: np.ndarray) -> tuple[np.ndarray, float]:
    """Joint positions (n,), rad or m, from `begin` (n,) on, at which the outputs come near `wanted` (ny,), and the
    largest distance that is left, m."""
    at, x, n = model.stepped, model.start(), len(begin)
    x[:n] = begin
    low, high = (np.array(side) for side in zip(*at.spans, strict=True))
    for _ in range(STEPS):
        e = wanted - model.outputs(x)
        if np.abs(e).max() < CLOSE:
            break
        nudged = np.repeat(x[None], n, axis=0)
        nudged[:, :n] += 1e-6 * np.eye(n)
        J = (model.outputs(nudged) - model.outputs(x)).T / 1e-6
        x[:n] = np.clip(x[:n] + J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(len(e)), e), low, high)
    return x[:n].copy(), float(np.abs(wanted - model.outputs(x)).max())
