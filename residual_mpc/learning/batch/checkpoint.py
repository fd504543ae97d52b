"""Learning that survives being killed at any moment: the belief on disk, whole or not at all."""

import hashlib
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from residual_mpc.learning.filter.kalman import Belief

FILE = "checkpoint.npz"  # in the output folder


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """After `update` updates: the belief, the channels' mean square error of late (C,), the H2 norms (n,) of all steps
    and the filter's times (update,) ms so far, and of each finished pass the gap on the windows set aside and the
    weights (passes, L)."""

    update: int
    belief: Belief
    error: np.ndarray
    h2: np.ndarray
    update_ms: np.ndarray
    pass_gap: np.ndarray
    pass_theta: np.ndarray


def fingerprint(*parts: object) -> str:
    """Tells one call from another: arrays and files by content, all else by repr."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
        digest.update(b"|")
    return digest.hexdigest()


def save(path: Path, call: str, c: Checkpoint) -> None:
    """Write, then rename: whoever reads finds the last whole checkpoint or this one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = tempfile.NamedTemporaryFile(dir=path.parent, prefix=".checkpoint-", suffix=".part", delete=False)
    try:
        with part:
            np.savez(
                part, call=call, update=c.update, mean=c.belief.mean, covariance=c.belief.covariance, error=c.error,
                h2=c.h2,
                update_ms=c.update_ms, pass_gap=c.pass_gap, pass_theta=c.pass_theta,
            )  # fmt: skip
            part.flush()
            os.fsync(part.fileno())
        os.replace(part.name, path)
    except BaseException:
        Path(part.name).unlink(missing_ok=True)
        raise


def resume(path: Path, call: str) -> Checkpoint | None:
    """The checkpoint of this very call; None where there is none, or it is another call's or no checkpoint at all."""
    try:
        with np.load(path, allow_pickle=False) as f:
            if str(f["call"]) != call:
                return None
            return Checkpoint(
                int(f["update"]), Belief(f["mean"], f["covariance"]), f["error"], f["h2"],
                f["update_ms"], f["pass_gap"],
                f["pass_theta"],
            )  # fmt: skip
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def clear(path: Path) -> None:
    """Away with a finished call's checkpoint, and with parts that a killed one left."""
    path.unlink(missing_ok=True)
    for part in path.parent.glob(".checkpoint-*.part"):
        part.unlink(missing_ok=True)
