"""PyBullet, which is an extra: imported at first use, with a word on how to get it."""

from typing import Any

from residual_mpc.errors import BadInput


def import_pybullet() -> Any:
    """The module. Raises BadInput with the install command where it is missing."""
    try:
        import pybullet
    except ImportError as error:
        raise BadInput(
            "PyBullet is not installed", "pybullet", 'install it with: pip install "residual-mpc[pybullet]"'
        ) from error
    return pybullet
