"""A row measured by its command in a process of its own, or read from the folder that keeps what was measured."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import click

from benchmarks.recorded.rows import Row


@dataclass(frozen=True)
class Measured:
    """What a row's command printed (None where it failed), how long it took (s), and the command as shown."""

    row: Row
    document: dict[str, Any] | None
    seconds: float
    shown: str
    trouble: str = ""


def measure(row: Row, data: Path, keep: Path, again: bool = False) -> Measured:
    """Run the row's command on its folder, or read what it came to."""
    folder = data / row.folder
    out = keep / re.sub(r"\W+", "-", row.name)
    if not (folder / "robot.toml").is_file():
        return Measured(row, None, 0.0, "", f"{folder} is absent")
    robot = folder / "robot.toml" if row.mass is None else changed(folder, row.mass, out / "model")
    words = [row.command, "--robot", str(robot), str(folder), *row.options]
    words += ["--out", str(out)] if row.command == "diagnose" else []
    shown = shlex.join(["residual-mpc", *words])
    click.echo(f"{row.name}: {shown}", err=True)
    kept, code = out / "measured.json", commit()
    if kept.is_file() and not again:
        was = json.loads(kept.read_text(encoding="utf-8"))
        if (was["shown"], was["code"]) == (shown, code):
            return Measured(row, was["document"], was["seconds"], shown)
    begin = perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "residual_mpc.cli.main", *words, "--json"], stdout=subprocess.PIPE, check=False
    )
    seconds = perf_counter() - begin
    if done.returncode:
        return Measured(row, None, seconds, shown, f"exit status {done.returncode}")
    printed = json.loads(done.stdout)
    out.mkdir(parents=True, exist_ok=True)
    kept.write_text(
        json.dumps({"shown": shown, "code": code, "seconds": seconds, "document": printed}), encoding="utf-8"
    )
    return Measured(row, printed, seconds, shown)


def changed(folder: Path, mass: float, place: Path) -> Path:
    """A copy of the robot file and its models in `place` with another mass (kg)."""
    place.mkdir(parents=True, exist_ok=True)
    for model in folder.glob("*.xml"):
        text, count = re.subn(r'mass="[^"]*"', f'mass="{mass:g}"', model.read_text())
        if count != 1:
            raise ValueError(f"{model} holds {count} masses, one was wanted")
        (place / model.name).write_text(text)
    return Path(shutil.copy(folder / "robot.toml", place))


def commit() -> str:
    """The last commit of the code that diagnoses, and whether it was changed since; empty outside a checkout."""
    code = ("--", "residual_mpc", "plants")
    last, changes = (_git("log", "-1", "--format=%h", *code), _git("status", "--porcelain", *code))
    return f" (commit {last}{', changed since' if changes else ''})" if last else ""


def _git(*words: str) -> str:
    root = Path(__file__).resolve().parents[2]
    try:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:  # no git here
        return ""
