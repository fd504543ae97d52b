"""A short digest of a run's samples, by which the run is recognised."""

import hashlib
from collections.abc import Iterable

import numpy as np

from residual_mpc.logs.run import Run

LENGTH = 16  # hexadecimal digits


def run_digest(run: Run) -> str:
    """Identical for identical samples, whatever the run's name or start time. Columns that the robot does not have are
    ignored."""
    digest = hashlib.sha256(np.ascontiguousarray(run.t - run.t[0]).tobytes())
    for name, values in sorted(run.columns.items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()[:LENGTH]


def run_digests(runs: Iterable[Run]) -> list[dict[str, str]]:
    """The name and digest of each run, as diagnosis.json lists them."""
    return [{"name": run.name, "digest": run_digest(run)} for run in runs]
