"""Checks of the arrays that users pass to a model."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.errors import BadInput


def check_last(name: str, given: np.ndarray, names: Sequence[str], most: int | None = None) -> None:
    """Raises BadInput unless the array is of numbers and its last axis has an entry for each of these names; most: axes
    that it may have, None for any number."""
    shape = np.shape(given)
    if not np.issubdtype(np.asarray(given).dtype, np.number):
        raise BadInput(f"{name} must be numbers, got {np.asarray(given).dtype}", name, f"give {', '.join(names)}")
    if not shape or shape[-1] != len(names) or len(shape) > (most or len(shape)):
        raise BadInput(
            f"{name} must have {len(names)} values in its last axis, got shape {shape}", name,
            f"give {', '.join(names)} in this order",
        )  # fmt: skip


def check_batches(x: np.ndarray, u: np.ndarray) -> None:
    """Raises BadInput where states and commands are batches of different shapes, none of which repeats."""
    try:
        np.broadcast_shapes(np.shape(x)[:-1], np.shape(u)[:-1])
    except ValueError as error:
        raise BadInput(
            f"x and u must have the same leading axes, got shapes {np.shape(x)} and {np.shape(u)}", "u",
            "give a command for each state, or one for all",
        ) from error  # fmt: skip
