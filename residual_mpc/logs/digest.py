"""A short name for the content of a run, by which it is known again."""

import hashlib

import numpy as np

from residual_mpc.logs.run import Run

LENGTH = 16  # hexadecimal digits


def run_digest(run: Run) -> str:
    """The same for the same samples, whatever the run is called. Columns that the robot does not have do not count."""
    digest = hashlib.sha256(np.ascontiguousarray(run.t - run.t[0]).tobytes())
    for name, values in sorted(run.columns.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:LENGTH]
