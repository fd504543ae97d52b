"""A program in a process and a folder of its own, with a short list of environment variables: what it is given is all
that it can know."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.errors import BadInput

# what a program needs to start at all; nothing else of the caller's environment reaches it
_ENVIRONMENT = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH",
                "MUJOCO_GL", "SYSTEMROOT", "TEMP", "TMP")  # fmt: skip
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_RUNNING: set[subprocess.Popen[str]] = set()  # by threads of this process


def stop_all() -> None:
    """End every program that threads of this process still wait for."""
    for process in list(_RUNNING):
        _kill(process)


@dataclass(frozen=True)
class ProcessResult:
    """How a process ended. status: "done", or why not; said: its stdout; complaint: its stderr."""

    status: str
    exit_status: int | None
    said: str
    complaint: str

    @property
    def done(self) -> bool:
        return self.status == "done"


def program(given: str, own: str) -> list[str]:
    """The first words of a call: those ``given``, else this installation's command ``own``; the program looked up."""
    installed = Path(sys.executable).with_name("residual-mpc")
    words = shlex.split(given) if given else [str(installed), *own.split()]
    found = shutil.which(words[0])
    if found is None:
        raise BadInput(f"program {words[0]!r} not found", "--command", "give its path, or install it")
    return [str(Path(found).absolute()), *words[1:]]


def run_isolated(
    call: list[str], work: Path, timeout: float, environment: Mapping[str, str] | None = None
) -> ProcessResult:
    """Call a program from the folder ``work``; it and whatever it started are ended after ``timeout`` seconds, or with
    this process. environment: for one that may know more than the short list."""
    known = {k: os.environ[k] for k in _ENVIRONMENT if k in os.environ} if environment is None else dict(environment)
    try:
        process = subprocess.Popen(
            call, cwd=work, env=known | _ONE_THREAD, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, errors="replace", start_new_session=True,
        )  # fmt: skip
    except OSError as error:
        return ProcessResult("not started", None, "", str(error))
    _RUNNING.add(process)
    try:
        said, complaint = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        _stop(process)
        return ProcessResult(f"over {timeout:g} s", None, "", "")
    except BaseException:  # Ctrl-C
        _stop(process)
        raise
    finally:
        _RUNNING.discard(process)
    return ProcessResult("done" if process.returncode == 0 else "failed", process.returncode, said, complaint)


def _stop(process: subprocess.Popen[str]) -> None:
    """End the process and whatever it started, and wait for it."""
    _kill(process)
    process.communicate()


def _kill(process: subprocess.Popen[str]) -> None:
    """End the process and whatever it started: its session is its own."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
