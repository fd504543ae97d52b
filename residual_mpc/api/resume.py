"""Where a command that was killed keeps what it had finished, and how that is known again."""

import hashlib
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

from residual_mpc.api.robot import NominalRobot
from residual_mpc.checkpoint import Checkpoint
from residual_mpc.logs.run import Run
from residual_mpc.models.robot_file import for_run

FILE = "resume.bin"


def checkpoint_in(folder: Path | None, key: str) -> Checkpoint:
    """The checkpoint in an output folder; one that keeps nothing without a folder."""
    return Checkpoint(None if folder is None else folder / FILE, key)


def key_of(robot: NominalRobot, runs: Iterable[Run], *said: object) -> str:
    """A digest of all that an answer depends on: the program, the robot with its model files, the runs, and what was
    `said` (options, seed), whose repr counts."""
    digest = hashlib.sha256(_program())
    names = []
    for run in runs:
        names.append(run.name)
        digest.update(run.name.encode())
        for name, values in (("t", run.t), *sorted(run.columns.items()), *sorted(run.extra_columns.items())):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(values).tobytes())
    for file in (robot.file, *(for_run(robot.file, name) for name in names)):
        digest.update(repr(file).encode())
        digest.update(b"" if file.model is None else _bytes(file.model))
    digest.update(_sources(type(robot.model).__module__))
    digest.update(repr(said).encode())
    return digest.hexdigest()


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def _program() -> bytes:
    """A digest of this package's sources and of the libraries that compute."""
    return f"{sys.version} {np.__version__}".encode() + _sources("residual_mpc")


@cache
def _sources(module: str) -> bytes:
    """A digest of the package that a module is in, of the module alone where it is in none."""
    top = sys.modules[module.partition(".")[0]]
    file = getattr(top, "__file__", None) or getattr(sys.modules[module], "__file__", None)
    if file is None:
        return b""
    home, digest = Path(file).parent, hashlib.sha256()
    for path in sorted(home.rglob("*.py")) if Path(file).name == "__init__.py" else [Path(file)]:
        digest.update(path.relative_to(home).as_posix().encode())
        digest.update(_bytes(path))
    return digest.digest()
