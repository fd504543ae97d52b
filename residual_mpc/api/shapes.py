"""Checks of the arrays that users pass to a model."""

from collections.abc import Sequence

import numpy as np

from residual_mpc.errors import BadInput


def check_last(name: str, given: np.ndarray, names: Sequence[str]) -> None:
    """Raises BadInput unless the last axis has an entry for each of these names."""
    shape = np.shape(given)
    if not shape or shape[-1] != len(names):
        raise BadInput(
            f"{name} must have {len(names)} values in its last axis, got shape {shape}", name,
            f"give {', '.join(names)} in this order",
        )  # fmt: skip
