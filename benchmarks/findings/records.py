"""What a case is: how its folder is made, what is true of it, and how it is diagnosed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

Planted = Mapping[str, Any]  # effect: {"target": ..., parameter: value}, or a list of these for several targets


@dataclass(frozen=True)
class Truth:
    """What was planted, and what counts as right.

    `said` is what 0.1.0 said, in words. `within` is the factor by which a named value may differ from the true one
    (None: values are not scored). `lacking`: `unknown` or `partial` without a wrong effect is right as well.
    `forbidden` are effects that cannot be at work there. `closes` is the share of the gap on other motions that is
    right where the causes are known to nobody.
    """

    level: str
    planted: Planted = field(default_factory=dict)
    background: Planted = field(default_factory=dict)
    encoders: bool = False
    said: str = ""
    within: float | None = None
    lacking: bool = False
    forbidden: Sequence[str] = ()
    closes: float | None = None

    def write(self, folder: Path) -> None:
        """Put truth.json into a case's folder."""
        (folder / "truth.json").write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


Maker = Callable[[Path, Path], None]  # (the case's folder, the folder of recorded robots)


@dataclass(frozen=True)
class Case:
    """One line of the page.

    `make` writes robot.toml, truth.json and most often run*.csv.gz into the case's folder. `data` names the folder of
    recorded runs that it needs; where the case's folder holds no runs, those of `data` that `motions` names are
    diagnosed.
    With `judged` the diagnosed model is measured on all other runs of `data` afterwards.
    """

    name: str
    finding: int
    make: Maker
    options: tuple[str, ...] = ()
    data: str | None = None
    motions: tuple[str, ...] = ("*",)
    judged: bool = False


def write_robot(folder: Path, lines: Sequence[str]) -> None:
    """Write robot.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_drive(folder: Path, wheel_radius: float, track_width: float, more: Sequence[str] = ()) -> None:
    """The robot file of a differential drive (m)."""
    head = ['name = "rover"', 'plant = "diff_drive"', "[parameters]"]
    write_robot(folder, [*head, f"wheel_radius = {wheel_radius:.6g}", f"track_width = {track_width:.6g}", *more])


def write_run(folder: Path, name: str, columns: Mapping[str, Any], digits: int = 6) -> None:
    """Write one run as a compressed table; the same columns give the same bytes."""
    import pandas as pd

    pd.DataFrame(dict(columns)).to_csv(
        folder / f"{name}.csv.gz",
        index=False,
        float_format=f"%.{digits}f",
        compression={"method": "gzip", "mtime": 0},
    )
