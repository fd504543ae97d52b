"""`python -m benchmarks.gallery [NAME...]`: makes the reports of the documentation's gallery, and pictures of them.

Reports and their animations go to build/gallery, from where `make docs` takes them into the site; pictures of their
first screens go to docs/gallery, which the repository has. Recorded robots need --data; pictures need Chromium.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
import pandas as pd
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
KEPT, PICTURES = ROOT / "build" / "gallery", ROOT / "docs" / "gallery"
SCREEN, WIDTH, QUALITY = (1040, 1240), 800, 78  # px, px and of a WebP
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
MPC = ("-m", "residual_mpc.cli.main")

Words = tuple[str, ...]


@dataclass(frozen=True)
class Exhibit:
    """calls: arguments of Python, one call after the other in a folder of their own; page: what they leave; prepare:
    called before with the folder of recorded robots and the working folder; recorded: whether it needs the former."""

    calls: tuple[Words, ...]
    page: str = "out/report.html"
    prepare: Callable[[Path, Path], None] = lambda data, here: None
    recorded: bool = False


def situation(name: str) -> Exhibit:
    """A robot of docs/examples/situations.py."""
    script = str(ROOT / "docs" / "examples" / "situations.py")
    return Exhibit(((script, name, "."), (*MPC, "diagnose", "--robot", "robot.toml", ".", "--out", "out")))


def copied(*names: str) -> Callable[[Path, Path], None]:
    """Files of a recorded robot, by pattern."""

    def prepare(data: Path, here: Path) -> None:
        for pattern in names:
            for path in data.glob(pattern):
                shutil.copy(path, here)

    return prepare


def every_sixth_window(data: Path, here: Path) -> None:
    """Of the Husky's 402 recorded windows."""
    copied("husky_drive/robot.toml")(data, here)
    table = pd.read_parquet(data / "husky_drive" / "windows.parquet")
    table[table.run.isin(sorted(table.run.unique())[::6])].to_parquet(here / "sixth.parquet")


DIAGNOSE = (*MPC, "diagnose", "--robot", "robot.toml", ".", "--out", "out")
DEMO = ("-m", "residual_mpc.demo", "--seed", "7", "--out", "demo", "--no-show")
BLIND = tuple("blind make --out suite --family wheeled --level double --cases 1 --seed 4100".split())
CASE = "suite/cases/case-0001"
COMPARED = ("compare", "--robot", "robot.toml", "--before", "before", "--after", "after", "--out", "out")
SETS = "from pathlib import Path; from comparison.rovers import write_sets; write_sets(Path('.'), track=1.1)"
EXHIBITS = {
    "turtlebot": Exhibit((DEMO,), "demo/diagnosis/report.html"),
    "drive": Exhibit((DEMO,), "demo/drive/drive.html"),
    "rover": Exhibit(((*MPC, *BLIND), (*MPC, "diagnose", "--robot", f"{CASE}/robot.toml", CASE, "--out", "out"))),
    "payload": situation("payload"),
    "compare": Exhibit((("-c", SETS), (*MPC, *COMPARED))),
    "xl330": Exhibit((DIAGNOSE,), prepare=copied("xl330/*"), recorded=True),
    "husky": Exhibit((DIAGNOSE,), prepare=every_sixth_window, recorded=True),
}


def make(name: str, data: Path) -> Path:
    """Run an exhibit and keep its page; returns where."""
    exhibit, kept = EXHIBITS[name], KEPT / f"{name}.html"
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        exhibit.prepare(data, Path(folder))
        for words in exhibit.calls:
            subprocess.run([sys.executable, *words], cwd=folder, env=environment, check=True)
        KEPT.mkdir(parents=True, exist_ok=True)
        shutil.copy(Path(folder) / exhibit.page, kept)
    return kept


def photograph(page: Path, picture: Path) -> None:
    """The first screen of a page as a WebP, by the browser that is there."""
    browser = next((b for b in BROWSERS if shutil.which(b)), None)
    if browser is None:
        click.echo(f"no picture of {page.name}: none of {', '.join(BROWSERS)} is on the PATH", err=True)
        return
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "shot.png"
        size = f"--window-size={SCREEN[0]},{SCREEN[1]}"
        call = [browser, "--headless", "--no-sandbox", "--hide-scrollbars", size, f"--screenshot={shot}", page.as_uri()]
        subprocess.run(call, check=True, capture_output=True)
        image = Image.open(shot).convert("RGB")
        image.thumbnail((WIDTH, 10 * WIDTH))
        picture.parent.mkdir(exist_ok=True)
        image.save(picture, format="WEBP", quality=QUALITY, method=6)


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(list(EXHIBITS)))
@click.option("--data", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared/data"),
              show_default=True, help="Folder of the recorded robots.")  # fmt: skip
def main(names: tuple[str, ...], data: Path) -> None:
    """Make the reports of the gallery; all of them where no NAMES are given."""
    for name in names or EXHIBITS:
        if EXHIBITS[name].recorded and not data.is_dir():
            click.echo(f"{name} is left out: there are no recorded robots in {data}; give --data", err=True)
            continue
        click.echo(name)
        photograph(make(name, data.resolve()), PICTURES / f"{name}.webp")


if __name__ == "__main__":
    main()
