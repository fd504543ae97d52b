"""Errors for arrays that a controller cannot use."""

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented


def wrong_state(model: Augmented, shape: tuple[int, ...]) -> BadInput:
    """The error for a state x of a shape other than (nx,)."""
    states = ", ".join(model.stepped.states)
    return BadInput(f"x must have shape ({model.nx},), got {shape}", "", f"give {states} in this order")


def nothing_to_hold(model: Augmented, x: np.ndarray) -> BadInput:
    """The error for a state x (nx,) that is not finite at the first sample."""
    at = np.flatnonzero(~np.isfinite(x))[0]
    what = (
        f"x must be finite at the first sample, when there is no plan to hold, got {model.stepped.states[at]} {x[at]}"
    )
    return BadInput(what, "", "call step once the state is known")
