"""CasADi functions made fast: compiled by gcc where it is found, else on CasADi's own virtual machine."""

import ctypes
import hashlib
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.extras import extra

COMPILERS = ("gcc", "cc", "clang")
LONG = 500_000  # characters of C source, beyond which -O2 takes minutes and gives no faster code than -O1
_LOADED: dict[str, Any] = {}  # by the hash of the source: the same model is compiled once a process
_FOLDERS: list[tempfile.TemporaryDirectory[str]] = []  # kept for as long as the libraries in them are loaded


def compiler() -> str | None:
    """The C compiler that is there, or None."""
    return next((c for c in COMPILERS if shutil.which(c)), None)


def compiled(function: Any, with_compiler: str | None) -> Any:
    """The same function, from a shared library; `function` itself where with_compiler is None or compiling fails.

    One function of loops and small bodies takes a second or two; whole solvers unrolled take a minute (do not).
    """
    with extra("mpc"):
        import casadi as ca

    if with_compiler is None:
        return function
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    source = generator.dump()
    key = hashlib.sha256(source.encode()).hexdigest()
    if key not in _LOADED:
        if not _FOLDERS:
            _FOLDERS.append(tempfile.TemporaryDirectory(prefix="residual-mpc-"))
        base = Path(_FOLDERS[0].name) / f"{function.name()}-{key[:16]}"
        base.with_suffix(".c").write_text(source, encoding="utf-8")
        effort = "-O2" if len(source) < LONG else "-O1"
        command = [with_compiler, effort, "-fPIC", "-shared", f"{base}.c", "-o", f"{base}.so", "-lm"]
        try:
            subprocess.run(command, capture_output=True, check=True, timeout=120)
            ctypes.CDLL(f"{base}.so")  # a library that does not load would end the process inside CasADi
            _LOADED[key] = ca.external(function.name(), f"{base}.so")
        except (OSError, subprocess.SubprocessError, RuntimeError):
            _LOADED[key] = function  # slower, the same numbers to rounding
    return _LOADED[key]


@dataclass(frozen=True, eq=False)
class Buffered:
    """A function on fixed arrays: write into `arguments`, call `run`, read `results`; microseconds less a call.

    arguments, results: flat arrays, column-major as CasADi has them.
    """

    arguments: tuple[np.ndarray, ...]
    results: tuple[np.ndarray, ...]
    run: Any
    buffer: Any  # keeps the memory that `run` points to


def buffered(function: Any, sizes: Sequence[int], outputs: Sequence[int]) -> Buffered:
    """Arrays for a function with dense arguments and results of these lengths."""
    buffer, run = function.buffer()
    arguments = tuple(np.zeros(n) for n in sizes)
    results = tuple(np.zeros(n) for n in outputs)
    for i, a in enumerate(arguments):
        buffer.set_arg(i, a.data)
    for i, r in enumerate(results):
        buffer.set_res(i, r.data)
    return Buffered(arguments, results, run, buffer)
