"""What a diagnosis costs compared with an earlier version: processor seconds and memory on the same cases.

residual-mpc blind make --out suite --family wheeled=40 --family arm=20 --seed 30000
python -m benchmarks.versions suite --old 676a877 --out build/versions
residual-mpc blind score suite --results build/versions/old
residual-mpc blind score suite --results build/versions/new

Each case is diagnosed by the earlier version and by the files of this folder in turn, one process at a time, in the
same environment. PLACES are suites, or folders with a robot.toml and runs. Cases that have been diagnosed are not
diagnosed again.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import click

from residual_mpc.blind.suite import read_suite, write_json

ROOT = Path(__file__).parents[1]
PROGRAM = "import sys; from residual_mpc.cli.main import main; sys.argv[0] = 'residual-mpc'; main()"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # of linear algebra


@dataclass(frozen=True)
class Case:
    """name: unique in a call; folder: with robot.toml and runs; without: effects that the diagnosis is not to name."""

    name: str
    folder: Path
    family: str
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cost:
    """Of one diagnosis: processor time of all its threads and processes, s; the largest memory, bytes; exit status;
    first: s from its start until it has said how large the gap is and what it resembles, None where it never did;
    version: of the program."""

    seconds: float
    memory: int
    status: int
    first: float | None = None
    version: str = ""


@click.command()
@click.argument(
    "places", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, file_okay=False, resolve_path=True)
)
@click.option("--old", default="676a877", show_default=True, help="Commit to compare with.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False, resolve_path=True), required=True)
@click.option("--most", type=click.IntRange(min=1), help="Number of cases.  [default: all]")
def versions(places: tuple[Path, ...], old: str, out: Path, most: int | None) -> None:
    """Diagnose every case with both versions and print a row for each, and the medians by family."""
    trees = {"old": (unpacked(old, out / "tree"), old), "new": (ROOT, _described())}
    cases = cases_of(places)[:most]
    rows: dict[str, list[tuple[Cost, Cost]]] = {case.family: [] for case in cases}
    click.echo("| case | s before | s now | ratio | first answer, s | GB before | GB now | before | now |")
    click.echo("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for case in cases:
        before, now = (diagnosed(case, *tree, out / name / case.name) for name, tree in trees.items())
        said = " | ".join(answer(out / name / case.name) for name in trees)
        if before.status or now.status:
            click.echo(f"| {case.name} | | | | | | | {said} |")
            continue
        rows[case.family].append((before, now))
        first, ratio = "" if now.first is None else f"{now.first:.1f}", now.seconds / before.seconds
        click.echo(
            f"| {case.name} | {before.seconds:.1f} | {now.seconds:.1f} | {ratio:.2f} | {first} | "
            f"{before.memory / 1e9:.2f} | {now.memory / 1e9:.2f} | {said} |"
        )
    for name, costs in rows.items():
        if costs:
            click.echo(summary(name, costs))


def cases_of(places: Sequence[Path]) -> list[Case]:
    """The cases of these suites and folders. Raises click.UsageError where two have the same name."""
    found: list[Case] = []
    for place in places:
        if (place / "suite.json").exists():
            suite = read_suite(place)
            found += [Case(e.name, suite.case(e), e.family, e.without) for e in suite.cases]
        else:
            if not (place / "robot.toml").exists() or not _runs(place):
                raise click.UsageError(
                    f"{place}: neither a suite nor a folder with a robot.toml and runs (.csv, .parquet)"
                )
            found.append(Case(place.name, place, "robot"))
    twice = sorted(name for name, n in Counter(c.name for c in found).items() if n > 1)
    if twice:
        raise click.UsageError(
            f"cases must have different names, got {', '.join(twice)} twice: call once for each suite"
        )
    return found


def unpacked(commit: str, place: Path) -> Path:
    """The files of a commit, below a folder. Raises click.UsageError for an unknown commit."""
    tree, part = place / commit, place / f"{commit}.part"
    if tree.exists():
        return tree
    packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True)
    if packed.returncode:
        raise click.UsageError(f"--old {commit}: {packed.stderr.decode(errors='replace').strip()}")
    shutil.rmtree(part, ignore_errors=True)  # of a call that was stopped
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(part, filter="data")
    part.rename(tree)
    return tree


def _described() -> str:
    """The commit of this folder, and whether it has changed since."""
    said = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return said.stdout.strip()


def _runs(folder: Path) -> list[str]:
    return sorted(str(path) for path in folder.iterdir() if path.suffix in {".csv", ".parquet"})


def diagnosed(case: Case, tree: Path, version: str, out: Path) -> Cost:
    """What a diagnosis by the files of `tree` costs; read from beside `out` where this version made it before."""
    kept, log_file = (out.parent / f"{out.name}.{end}" for end in ("cost.json", "log"))
    if kept.exists() and (known := Cost(**json.loads(kept.read_text(encoding="utf-8")))).version == version:
        return known
    shutil.rmtree(out, ignore_errors=True)  # one that was stopped would go on where it was
    out.parent.mkdir(parents=True, exist_ok=True)
    left_out = [word for effect in case.without for word in ("--without", effect)]
    what = ["--robot", str(case.folder / "robot.toml"), *_runs(case.folder), *left_out, "--out", str(out)]
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(tree)}
    begin, first = perf_counter(), None
    with log_file.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "diagnose", *what],
            cwd=tree, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        assert process.stdout is not None
        for line in process.stdout:
            log.write(line)
            if first is None and line.startswith("first look"):
                first = perf_counter() - begin
        process.stdout.close()
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    cost = Cost(used.ru_utime + used.ru_stime, used.ru_maxrss * 1024, process.returncode, first, version)
    ended = "done" if not cost.status else f"exit status {cost.status}"
    out.mkdir(exist_ok=True)
    # for `residual-mpc blind score`
    write_json(out / "run.json", {"status": ended, "seconds": cost.seconds, "version": version})
    write_json(kept, asdict(cost))
    return cost


def answer(out: Path) -> str:
    """The verdict and the names of a diagnosis, or that it failed."""
    document = out / "diagnosis.json"
    if not document.exists():
        return "failed"
    found: dict[str, Any] = json.loads(document.read_text(encoding="utf-8"))
    named = (f"{e['effect']} {e['target'] or ''}".strip() + f" {e['probability']:.2f}" for e in found["explanation"])
    return f"`{found['verdict']}` {', '.join(named)}".strip()


def summary(name: str, costs: Sequence[tuple[Cost, Cost]]) -> str:
    """The medians of one family and the range of its ratios."""
    ratios = [now.seconds / before.seconds for before, now in costs]
    before, now = (median(pair[i].seconds for pair in costs) for i in range(2))
    return (
        f"{name}, {len(costs)} cases: median {before:.1f} s before, {now:.1f} s now; ratio of each case "
        f"{median(ratios):.2f} in the median ({min(ratios):.2f} to {max(ratios):.2f}); all together "
        f"{sum(pair[1].seconds for pair in costs) / sum(pair[0].seconds for pair in costs):.2f}; largest memory "
        f"{max(pair[0].memory for pair in costs) / 1e9:.2f} and {max(pair[1].memory for pair in costs) / 1e9:.2f} GB"
    )


if __name__ == "__main__":
    versions()
