"""The joints' positions at which an arm's tool is where a reference begins."""

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented

STEPS, CLOSE = 200, 1e-4  # Gauss-Newton steps, m
DAMPING = 1e-3  # m^2/rad^2


def posture_at(model: Augmented, wanted: np.ndarray) -> dict[str, float]:
    """Positions by channel at which the model's outputs are `wanted` (ny,), near home.

    Raises BadInput where the tool cannot get there.
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
        f"the tool comes no nearer than {np.abs(e).max():.3g} m to where the reference begins", model.robot.name,
        "begin the reference within reach, or give it as positions of the joints",
    )  # fmt: skip
