"""Other settings of the same robot: model files beside the given one, named like some of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from residual_mpc.errors import BadInput
from residual_mpc.init.columns.guess import Guess
from residual_mpc.init.columns.recording import Recording
from residual_mpc.models.model_structure import ModelStructure, read_model_structure

MARKS = "_-./ "


@dataclass(frozen=True)
class RunSetting:
    """One [[variant]]: runs is a glob pattern on their names."""

    runs: str
    model: Path


def find_settings(
    model: Path, structure: ModelStructure, recordings: Sequence[Recording]
) -> tuple[tuple[RunSetting, ...], tuple[Guess, ...]]:
    """A variant for each model file beside `model` whose stem begins the names of runs, if `model`'s begins some too.

    Such files name the same joints and actuators, and every run is then of one of them.
    """
    names = [r.label or r.name for r in recordings]
    beside = sorted(p for p in model.parent.iterdir() if p.suffix == model.suffix and p.is_file())
    begun = {path: [n for n in names if _begins(path.stem, n)] for path in beside}
    begun = {path: mine for path, mine in begun.items() if mine}
    covered = [n for mine in begun.values() for n in mine]
    if len(begun) < 2 or not any(p.samefile(model) for p in begun) or sorted(covered) != sorted(names):
        return (), ()
    if not all(p.samefile(model) or _alike(p, structure) for p in begun):
        return (), ()
    settings, guesses = [], []
    for path, mine in begun.items():
        pattern = f"{path.stem}*"
        settings.append(RunSetting(pattern, path))
        why = f"the names of {len(mine)} runs begin with its name, and it has the same joints and actuators"
        guesses.append(Guess(f"model of the runs {pattern}", path.name, why, 0.85))
    return tuple(settings), tuple(guesses)


def _begins(stem: str, run: str) -> bool:
    return run == stem or run.startswith(stem) and run[len(stem)] in MARKS


def _alike(path: Path, structure: ModelStructure) -> bool:
    try:
        other = read_model_structure(path)
    except BadInput:
        return False
    joints = [j.name for j in other.joints] == [j.name for j in structure.joints]
    return joints and other.actuators == structure.actuators
