"""Errors for arrays of the wrong shape, which a controller may be given at every sample."""

from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented


def wrong_state(model: Augmented, shape: tuple[int, ...]) -> BadInput:
    """The error for a state x of a shape other than (nx,)."""
    states = ", ".join(model.stepped.states)
    return BadInput(f"x must have shape ({model.nx},), got {shape}", "", f"give {states} in this order")
