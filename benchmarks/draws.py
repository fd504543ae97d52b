"""Random choices of a recorded robot's runs: is each diagnosis right about the other runs, and do they agree?

python -m benchmarks.draws [--shared ../shared] [--source so101] [--runs 10] [--draws 5] [--seed 0]
                           [--out build/draws] [--page FILE]

Nobody knows the causes on a recorded robot. A diagnosis can still be checked in two ways: how much of the gap on runs
that it has not seen its model closes, and whether the numbers from other runs lie within its intervals. The recordings
are no part of this repository; a source whose folder is absent says so. A call that was stopped goes on where it was.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from time import perf_counter
from typing import Any

import click
import numpy as np

from benchmarks.recorded.measure import commit
from benchmarks.recorded_changes import SOURCES

Number = tuple[str, str | None, str]  # effect, target, parameter


@dataclass(frozen=True)
class Draw:
    """One diagnosis: the runs it was made from, the gap on all others before and after, and what it names, as
    probability by effect and target and as (low, value, high) by number."""

    runs: tuple[str, ...]
    verdict: str
    before: float
    after: float
    floor: float
    named: dict[tuple[str, str | None], float]
    numbers: dict[Number, tuple[float, float, float]]
    seconds: float

    @property
    def closed(self) -> float:
        """The share of the gap on the other runs that the model closes."""
        return 1.0 - self.after / self.before


@click.command()
@click.option("--shared", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared"),
              show_default=True)  # fmt: skip
@click.option("--source", type=click.Choice([s.name for s in SOURCES]), default="so101", show_default=True)
@click.option("--runs", type=click.IntRange(min=1), default=10, show_default=True, help="In each draw.")
@click.option("--draws", type=click.IntRange(min=1), default=5, show_default=True)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the first draw.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("build/draws"),
              show_default=True)  # fmt: skip
@click.option("--page", type=click.Path(path_type=Path, dir_okay=False), help="Also write the tables to this file.")
def draw_runs(
    shared: Path, source: str, runs: int, draws: int, seed: int, out: Path, page: Path | None
) -> None:  # fmt: skip
    """Diagnose random choices of a recorded robot's runs, and measure each model on all other runs."""
    data = shared / "data" / next(s.folder for s in SOURCES if s.name == source)
    files = sorted(p for p in data.glob("*") if p.suffix in (".parquet", ".csv"))
    if not (data / "robot.toml").is_file() or len(files) <= runs:
        click.echo(f"{source}: {data} is absent or has no more than {runs} runs; nothing was measured")
        return
    found = []
    for k in range(seed, seed + draws):
        some = np.sort(np.random.default_rng(k).choice(len(files), runs, replace=False))
        click.echo(f"{source}, draw {k}", err=True)
        found.append(one_draw(data / "robot.toml", files, some.tolist(), out / f"{source}-{runs}-{k}"))
    text = tables(found)
    click.echo(text)
    if page is not None:
        page.write_text(text + "\n", encoding="utf-8")


def one_draw(robot: Path, files: Sequence[Path], some: Sequence[int], out: Path) -> Draw:
    """The draw of these of the files; read from `out` if committed code has made it from the same files before."""
    kept, code = out / "draw.json", commit()
    chosen = [str(files[i]) for i in some]
    others = [str(f) for i, f in enumerate(files) if i not in set(some)]
    made = {"code": code, "runs": chosen, "others": others}
    if kept.is_file() and code and "changed" not in code:
        was = json.loads(kept.read_text(encoding="utf-8"))
        if all(was.get(key) == value for key, value in made.items()):
            return read(was)
    begin = perf_counter()
    diagnosis = _run(["diagnose", "--robot", str(robot), *chosen, "--out", str(out)])
    seconds = perf_counter() - begin
    gap = _run(["gap", "--robot", str(robot), *others, "--model", str(out / "diagnosis.json")])
    was = {**made, "diagnosis": diagnosis, "gap": gap, "seconds": seconds}
    kept.write_text(json.dumps(was), encoding="utf-8")
    return read(was)


def _run(words: Sequence[str]) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "residual_mpc.cli.main", *words, "--json"], stdout=subprocess.PIPE, check=True
    )
    printed: dict[str, Any] = json.loads(done.stdout)
    return printed


def read(kept: dict[str, Any]) -> Draw:
    """A draw as it was kept."""
    diagnosis, gap = kept["diagnosis"], kept["gap"]
    named = {(e["effect"], e["target"]): float(e["probability"]) for e in diagnosis["explanation"]}
    numbers = {
        (e["effect"], e["target"], name): (number["ci95"][0], number["value"], number["ci95"][1])
        for e in diagnosis["explanation"]
        for name, number in e["parameters"].items()
        if number["ci95"] is not None and number["value"] is not None
    }
    return Draw(
        tuple(Path(r).stem for r in kept["runs"]), diagnosis["verdict"], gap["nominal"], gap["model"],
        gap["noise_floor"], named, numbers, kept["seconds"],
    )  # fmt: skip


@dataclass(frozen=True)
class Agreement:
    """How one number compares between two draws, in halves of their intervals: apart, of the two added in squares; and
    whether the intervals overlap."""

    number: Number
    apart: float
    overlap: bool


def agreements(draws: Sequence[Draw]) -> list[Agreement]:
    """Of each number that two draws have both, for each pair of draws."""
    out = []
    for one, other in combinations(draws, 2):
        for number in sorted(set(one.numbers) & set(other.numbers), key=str):
            (low, value, high), (low2, value2, high2) = one.numbers[number], other.numbers[number]
            half = float(np.hypot(high - low, high2 - low2)) / 2.0
            apart = abs(value - value2) / half if half > 0.0 else float(np.inf if value != value2 else 0.0)
            out.append(Agreement(number, apart, low <= high2 and low2 <= high))
    return out


def tables(draws: Sequence[Draw]) -> str:
    """The draws, and the numbers beside each other."""
    lines = [
        "| draw | verdict | gap on the other runs | closed | floor | named (probability) | s |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for k, d in enumerate(draws, 1):
        names = ", ".join(f"{_of(*term)} ({p:.2f})" for term, p in d.named.items())
        lines.append(
            f"| {k} | `{d.verdict}` | {d.before:.3g} to {d.after:.3g} | {d.closed:.0%} | {d.floor:.2g} | {names} "
            f"| {d.seconds:.0f} |"
        )
    pairs = agreements(draws)
    lines += ["", "| number | " + " | ".join(f"draw {k}" for k in range(1, len(draws) + 1)) + " |"]
    lines.append("| --- |" + " --- |" * len(draws))
    for number in sorted({n for d in draws for n in d.numbers}, key=str):
        cells = [
            "{1:.3g} ({0:.3g} to {2:.3g})".format(*d.numbers[number]) if number in d.numbers else "" for d in draws
        ]
        lines.append(f"| {_of(*number[:2])}, {number[2]} | " + " | ".join(cells) + " |")
    if pairs:
        within = sum(p.apart <= 1.0 for p in pairs)
        lines += [
            "",
            f"Of {len(pairs)} numbers that two draws have both, {within} differ by no more than their intervals, added "
            f"in squares, allow ({within / len(pairs):.0%}); the intervals of {sum(p.overlap for p in pairs)} overlap.",
        ]
    return "\n".join(lines)


def _of(effect: str, target: str | None) -> str:
    return f"`{effect}`" if target is None else f"`{effect}` of {target}"


if __name__ == "__main__":
    draw_runs()
