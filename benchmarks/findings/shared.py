"""The cases that lie beside the repository: read, not made."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

from benchmarks.findings.records import Case

FINDINGS = {"coloured_noise": 1, "changed": 2, "slow": 6, "arm_soft": 12, "arm_lag": 12, "arm": 10, "limit_and": 13}
OTHERWISE = 6  # what is missed beside a larger effect


def cases(folder: Path) -> list[Case]:
    """One case for each folder with a truth.json, named shared_...; none where `folder` is absent."""
    found = sorted(path.parent for path in folder.glob("*/truth.json"))
    return [Case(f"shared_{path.name}", finding_of(path.name), partial(copied, path)) for path in found]


def finding_of(name: str) -> int:
    """The finding that a shared case belongs to."""
    return next((number for head, number in FINDINGS.items() if name.startswith(head)), OTHERWISE)


def copied(path: Path, folder: Path, _: Path) -> None:
    """Copy what a diagnosis may see, and the truth beside it; `fresh` stays where it is."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in sorted(path.iterdir()):
        if not file.name.startswith("fresh"):
            shutil.copyfile(file, folder / file.name)
