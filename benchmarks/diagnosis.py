"""`make bench`: what a diagnosis costs, by stage and by the size of the log, as ratios within one run.

python -m benchmarks.diagnosis [--repeats N] [--robot wheeled] [--robot arm] [--robot "long arm"]

Nothing here is a promise in seconds: the one absolute number, the seconds of the smallest log, says how large
the machine's unit is. A log is made larger by repeating its runs under other names, so that its answer stays
and only its cost grows.
"""

from __future__ import annotations

import resource
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

import click
import numpy as np

from residual_mpc.learning.batch.network_learner import LEARNERS

SIZES = (1, 2, 4)  # times the runs
STAGES = ("read and audit", "windows", "search", "rivals", "fit and forecast", "judge", "report")
BEGINS = {  # what `diagnose` reports as it goes -> the stage that begins there
    "splitting the runs into windows": "windows",
    "searching for effects": "search",
    "comparing with alternative explanations": "rivals",
    "fitting on all windows": "fit and forecast",
    "evaluating on the held-out windows": "judge",
}
ROBOTS = {
    "wheeled": ("wheeled", "double", 0, None),
    "arm": ("arm", "single", 41, 4),
    "long arm": ("arm", "double", 60, 6),  # ten minutes of it, once
}
LONG = 600.0  # s


@dataclass(frozen=True)
class Cost:
    """One diagnosis: seconds by stage, and the size of what it looked at."""

    seconds: dict[str, float]
    windows: int
    named: tuple[str, ...]

    @property
    def total(self) -> float:
        """s"""
        return sum(self.seconds.values())


@click.command()
@click.option("--repeats", type=click.IntRange(min=1), default=3, show_default=True, help="Medians are over these.")
@click.option("--robot", "robots", multiple=True, type=click.Choice(list(ROBOTS)), help="[default: all]")
def bench(repeats: int, robots: tuple[str, ...]) -> None:
    """Print the cost of a diagnosis by stage and by size, and the throughput of the replay."""
    chosen = robots or tuple(ROBOTS)
    with tempfile.TemporaryDirectory() as place:
        for robot in chosen:
            family, level, seed, joints = ROBOTS[robot]
            case = draw(family, level, seed, joints, Path(place) / robot)
            if robot == "long arm":
                click.echo(ten_minutes(case, Path(place) / "long"))
                continue
            click.echo(growth(robot, case, repeats, Path(place) / f"{robot}-more"))
            if robot == "arm":
                click.echo(throughput(case, repeats))


def draw(family: str, level: str, seed: int, joints: int | None, place: Path) -> Path:
    """The folder of a blind case, with as many joints as asked for."""
    from residual_mpc.blind.families import make_case

    for s in range(seed, seed + 50):
        click.echo(f"drawing a robot of family {family} (seed {s})", err=True)
        shutil.rmtree(place, ignore_errors=True)
        answer = make_case(family, level, s, place)
        if joints is None or answer.notes.get("joints") == joints:
            return place / "case"
    raise RuntimeError(f"no {family} with {joints} joints among 50 seeds from {seed}")


def growth(robot: str, case: Path, repeats: int, place: Path) -> str:
    """Stages down, sizes across."""
    costs = {}
    for size in SIZES:
        log = enlarge(case, size, place / str(size))
        found = []
        for k in range(repeats):
            click.echo(f"{robot}, {size} x the runs, {k + 1} of {repeats}", err=True)
            found.append(diagnose(log))
        costs[size] = middle(found)
        if costs[size].named != costs[SIZES[0]].named:
            click.echo(f"{robot}, {size} x the runs: names {', '.join(costs[size].named)} instead", err=True)
    first = costs[SIZES[0]]
    lines = [f"\n{robot}: {first.windows} windows of 1 s, names {', '.join(first.named) or 'nothing'}"]
    lines.append(f"  {'share of the time at':<22}" + "".join(f"{f'{s}x':>9}" for s in SIZES) + "   time 4x / 1x")
    for stage in STAGES:
        shares = "".join(f"{costs[s].seconds[stage] / costs[s].total:>9.0%}" for s in SIZES)
        ratio = costs[SIZES[-1]].seconds[stage] / first.seconds[stage]
        lines.append(f"  {stage:<22}{shares}   {ratio:>8.1f}")
    totals = "".join(f"{costs[s].total / first.total:>9.2f}" for s in SIZES)
    lines.append(f"  {'all, times that of 1x':<22}{totals}   (1x took {first.total:.1f} s here)")
    return "\n".join(lines)


def ten_minutes(case: Path, place: Path) -> str:
    """What a long log of an arm of six joints costs, as a multiple of the time that it lasts, and the memory it takes;
    its answer beside that of the log that it repeats."""
    import residual_mpc as rm

    runs = rm.read_runs(rm.load_robot(case / "robot.toml"), case).runs
    lasts = sum(float(r.t[-1] - r.t[0]) for r in runs)
    times = int(np.ceil(LONG / lasts))
    click.echo(f"long arm, {times} x {lasts:.0f} s", err=True)
    short, long = diagnose(case), diagnose(enlarge(case, times, place))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # kB on Linux
    return (
        f"\nten minutes of a six-joint arm: {times} x {lasts:.0f} s, {long.windows} windows; names "
        f"{', '.join(long.named) or 'nothing'} (once: {', '.join(short.named) or 'nothing'})\n"
        f"  a second of log costs {long.total / (times * lasts):.2f} s (once: {short.total / lasts:.2f} s); "
        f"{long.total:.0f} s in all here; at most {peak:.1f} GB"
    )


def enlarge(case: Path, size: int, folder: Path) -> Path:
    """A copy of the case with each run `size` times under different names."""
    folder.mkdir(parents=True)
    for path in case.iterdir():
        table = path.suffix in (".csv", ".parquet")
        for k in range(size if table else 1):
            shutil.copy(path, folder / (f"{path.stem}_{k}{path.suffix}" if table else path.name))
    return folder


def diagnose(log: Path) -> Cost:
    """One diagnosis, timed by the stages that it reports."""
    import residual_mpc as rm
    from residual_mpc.diagnosis.diagnose import diagnose as run_diagnosis
    from residual_mpc.diagnosis.options import Options
    from residual_mpc.diagnosis.results.document import to_document
    from residual_mpc.report import sentence, write_report
    from residual_mpc.report.evidence.collect import collect

    marks: list[tuple[str, float]] = [("read and audit", perf_counter())]

    def progress(text: str, done: float) -> None:
        if text in BEGINS:
            marks.append((BEGINS[text], perf_counter()))

    robot = rm.load_robot(log / "robot.toml")
    logged = rm.read_runs(robot, log)
    made = run_diagnosis(
        logged.runs,
        logged.models,
        dict(robot.file.noise),
        robot.file.tunable,
        Options(),
        np.random.default_rng(0),
        progress,
        LEARNERS,
    )
    marks.append(("report", perf_counter()))
    document = to_document(made.diagnosis)
    document["verdict_sentence"] = sentence(document)
    write_report(document, collect(made), log)
    ends = [at for _, at in marks[1:]] + [perf_counter()]
    seconds = dict.fromkeys(STAGES, 0.0)
    for (stage, begin), end in zip(marks, ends, strict=True):
        seconds[stage] += end - begin
    return Cost(seconds, made.data.count, tuple(c.term.effect for c in made.diagnosis.causes))


def middle(costs: list[Cost]) -> Cost:
    """Stage by stage the median."""
    seconds = {stage: median(c.seconds[stage] for c in costs) for stage in STAGES}
    return Cost(seconds, costs[0].windows, costs[0].named)


def throughput(case: Path, repeats: int) -> str:
    """What the batched replay costs beside a bare MuJoCo rollout of as many steps of the same model."""
    import mujoco
    from mujoco.batch import Batch

    import residual_mpc as rm
    from residual_mpc.diagnosis.data.dataset import build_dataset
    from residual_mpc.diagnosis.predict.replay import predict
    from residual_mpc.models.settings import Knob, assemble

    robot = rm.load_robot(case / "robot.toml")
    logged = rm.read_runs(robot, case)
    data = build_dataset(logged.runs, logged.models, dict(robot.file.noise))
    block = data.blocks[0]
    robot, drive = block.robot, block.drive
    model = robot.model  # type: ignore[attr-defined]
    joint, actuator = robot.slots("coulomb_friction")[0], robot.slots("voltage_sag")[0]
    slots = {e: robot.slots(e) for e in ("coulomb_friction", "voltage_sag")}
    rolled = {Knob("coulomb_friction", joint, "torque"): 0.01}
    stepped = {Knob("voltage_sag", actuator, "rate"): 0.001}
    rows = 4  # hypotheses, each on every window

    def bare() -> None:
        batch = Batch(model, rows * data.count, nthread=0)
        batch.reset()
        control = np.ascontiguousarray(np.tile(drive.command[:, drive.lead :], (rows, 1, 1)))
        batch.rollout(drive.steps, control, int(mujoco.mjtState.mjSTATE_CTRL), ("qpos", "qvel"))

    unit = timed(bare, repeats)
    lines = [
        f"\nreplay of {rows} x {data.count} windows of {drive.steps} steps, {model.nv} joints, "
        "against MuJoCo's own batched rollout"
    ]
    for name, values in (
        ("no effect", {}),
        ("dry friction", rolled),
        ("a weakening supply, stepped", stepped),
    ):
        settings = assemble([values] * rows, slots)
        cost = timed(lambda s=settings: predict(data, s), repeats)  # type: ignore[misc]
        lines.append(f"  {name:<30}{cost / unit:>7.1f} times the time")
    return "\n".join(lines)


def timed(work: Callable[[], object], repeats: int) -> float:
    """Median s of a call, after one that warms up."""
    work()
    found = []
    for _ in range(repeats):
        begin = perf_counter()
        work()
        found.append(perf_counter() - begin)
    return median(found)


if __name__ == "__main__":
    bench()
