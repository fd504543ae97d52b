"""LeRobot data sets: where their tables are and what their columns mean.

The layouts of versions 2.1 and 3.0: `meta/info.json` names the features, `data/chunk-*/` holds a Parquet table per
episode (`episode_000000.parquet`) or several episodes in one (`file-000.parquet`), told apart by `episode_index`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

INFO = Path("meta") / "info.json"  # in a folder above the tables
ABOVE = 4  # number of parent folders that are searched for it
FEATURES = {  # list column -> group of the log format
    "action": "command",
    "observation.state": "position",
    "observation.velocity": "velocity",
    "observation.effort": "effort",
}
KINDS = {"pos": "position", "vel": "velocity", "effort": "effort", "torque": "effort"}  # how an element's name may end


def is_data_set(folder: Path) -> bool:
    """Whether a folder is a LeRobot data set."""
    return (folder / INFO).is_file() and (folder / "data").is_dir()


def data_set_tables(folder: Path) -> list[Path]:
    """The tables of a data set, in the order of its episodes."""
    return sorted((folder / "data").rglob("*.parquet"))


def data_set_info(path: Path) -> Mapping[str, Any] | None:
    """The content of `meta/info.json`; empty if it cannot be read, None for a table outside a data set."""
    for folder in list(path.resolve().parents)[:ABOVE]:
        if (folder / INFO).is_file():
            try:
                info = json.loads((folder / INFO).read_text(encoding="utf-8"))
            except (OSError, ValueError, RecursionError):
                return {}
            return info if isinstance(info, dict) else {}
    return None


def meanings_of(names: Sequence[str]) -> dict[str, str]:
    """Column -> name of the log format: `action.elbow.pos` -> `command.elbow`."""
    meanings = {}
    for name in names:
        if name == "timestamp":
            meanings[name] = "t"
        elif name == "episode_index":
            meanings[name] = "run"
        for feature, group in FEATURES.items():
            if name.startswith(feature + "."):
                meanings[name] = _meaning(group, name.removeprefix(feature + "."))
    return meanings


def preferred_of(meanings: Mapping[str, str]) -> dict[str, str]:
    """Name of the log format -> the first column of that meaning."""
    preferred: dict[str, str] = {}
    for column, meaning in meanings.items():
        preferred.setdefault(meaning, column)
    return preferred


def _meaning(group: str, element: str) -> str:
    stem, _, ending = element.rpartition(".")
    if not stem or ending not in KINDS:
        return f"{group}.{element}"
    return f"{KINDS[ending] if group == 'position' else group}.{stem}"
