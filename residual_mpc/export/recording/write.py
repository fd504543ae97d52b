"""The recordings of some runs as files, one a run, with export.json beside them."""

import re
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from residual_mpc.export.recording.mcap_file import SUFFIX as MCAP_SUFFIX
from residual_mpc.export.recording.mcap_file import mcap_bytes
from residual_mpc.export.recording.recording import Recording
from residual_mpc.export.recording.rerun_file import SUFFIX as RERUN_SUFFIX
from residual_mpc.export.recording.rerun_file import rerun_bytes
from residual_mpc.export.recording.scene import scene
from residual_mpc.export.recording.trace import Trace
from residual_mpc.extras import extra
from residual_mpc.files import write_bytes_atomically

SUFFIXES = {"rerun": RERUN_SUFFIX, "mcap": MCAP_SUFFIX}  # of the formats that there are


def check_package(to: str) -> None:
    """Raises BadInput where the format's package is missing, before anything is computed."""
    if to == "mcap":
        with extra("mcap"):
            import_module("mcap.writer")
    else:
        with extra("rerun"):
            import_module("rerun")


def write_recording(recording: Recording, to: str, places: Sequence[Path]) -> list[str]:
    """Write trace i to places[i]; what could not be drawn comes back, as sentences without a full stop.

    Raises BadInput where the format's package is missing or a file cannot be written.
    """
    undrawn: dict[str, list[str]] = {}
    for trace, place in zip(recording.traces, places, strict=True):
        content, missing = _content(recording, trace, to)
        if missing:
            undrawn.setdefault(f"{missing[:1].lower()}{missing[1:].rstrip('.')}", []).append(trace.run)
        write_bytes_atomically(place, content)
    return [f"the robot in {', '.join(runs)}: {why}" for why, runs in undrawn.items()]


def file_names(runs: Sequence[str], to: str) -> list[str]:
    """One file name a run, all different, of letters that every file system takes."""
    out: list[str] = []
    for run in runs:
        stem = re.sub(r"[^\w.\-]+", "_", run).strip("._") or "run"
        same = 1
        while (name := f"{stem}{'' if same == 1 else f'_{same}'}{SUFFIXES[to]}").lower() in {n.lower() for n in out}:
            same += 1
        out.append(name)
    return out


def _content(recording: Recording, trace: Trace, to: str) -> tuple[bytes, str]:
    """A file, and why the robot is not in it; empty where it is, or where the format has no place for it."""
    if to == "mcap":
        return mcap_bytes(recording, trace), ""
    drawn: Any = scene(trace)
    why = drawn if isinstance(drawn, str) else ""
    return rerun_bytes(recording, trace, None if why else drawn), why
