"""PyBullet, which is an extra: imported at first use, with a word on how to get it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from residual_mpc.extras import extra


def import_pybullet() -> Any:
    """The module. Raises BadInput with the install command where it is missing."""
    with extra("pybullet"), _without_stderr():
        import pybullet
    return pybullet


@contextmanager
def _without_stderr() -> Iterator[None]:
    """Nothing reaches the process' standard error: PyBullet greets there from C, past sys.stderr."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
