"""Logs with the faults of real ones: is the same cause found as in the log without them?

python -m benchmarks.spoilt_logs [--fault NAME ...] [--seeds 2] [--first 0] [--out build/spoilt-logs.json]

The rovers are those of the benchmark of findings (an ODE of their own at 1 ms). One has no gap; the other's right wheel
is 4 to 8 % larger, and its commands act late. Each is logged in five runs of 20 s, which are then spoilt in one way.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from benchmarks.findings.motions import Array, Rng, drive
from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import write_drive, write_run
from benchmarks.findings.wheels import Drive, Sensors, logged
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically

RADIUS, TRACK = 0.05, 0.2  # m
RUNS, SECONDS, RATE = 5, 20.0, 50.0  # runs, s, Hz
POSE = ("pose.x", "pose.y", "pose.theta")
Table = dict[str, Array]
Executed = Callable[[Rng, int, Array], Array]  # what the motors get of the commands (n, 2) of a run
Spoilt = Callable[[Rng, int, Table], Table]  # the table of a run


def _as_sent(rng: Rng, run: int, sent: Array) -> Array:
    return sent


def _as_logged(rng: Rng, run: int, table: Table) -> Table:
    return table


@dataclass(frozen=True)
class Fault:
    """executed: of the commands; spoilt: of the log. lacking: whether the fault is beyond the noise, so that a perfect
    robot is `unknown` and the other one `partial` or explained; mistaken: a run that may be refused for it by name."""

    name: str
    executed: Executed = _as_sent
    spoilt: Spoilt = _as_logged
    lacking: bool = False
    mistaken: str = ""


def _stop(rng: Rng, run: int, sent: Array) -> Array:
    """An emergency stop of 3 s in one run."""
    begin = int(rng.uniform(5.0, 12.0) * RATE)
    out = sent.copy()
    if run == 2:
        out[begin : begin + int(3.0 * RATE)] = 0.0
    return out


def _late(rng: Rng, run: int, sent: Array) -> Array:
    """Motors that are switched on up to 2.5 s after the log begins."""
    out = sent.copy()
    out[: int(rng.uniform(1.5, 2.5) * RATE)] = 0.0
    return out


def _rows(table: Table, keep: NDArray[np.bool_]) -> Table:
    return {k: v[keep] for k, v in table.items()}


def _stretches(rng: Rng, table: Table, count: int, longest: float) -> NDArray[np.bool_]:
    """(n,) bool: within a few stretches of up to so many s."""
    t, inside = table["t"], np.zeros(len(table["t"]), dtype=bool)
    for begin in rng.uniform(1.0, SECONDS - 3.0, count):
        inside |= (t > begin) & (t < begin + rng.uniform(0.4, longest))
    return inside


def _gaps(rng: Rng, run: int, table: Table) -> Table:
    return _rows(table, ~_stretches(rng, table, 4, 1.2))


def _dropouts(rng: Rng, run: int, table: Table) -> Table:
    lost = _stretches(rng, table, 3, 1.5)
    return {k: np.where(lost, np.nan, v) if k in POSE else v for k, v in table.items()}


def _freezes(rng: Rng, run: int, table: Table) -> Table:
    lost = _stretches(rng, table, 2, 1.2)
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))
    return {k: v[last] if k in POSE else v for k, v in table.items()}


def _held(rng: Rng, run: int, table: Table) -> Table:
    """A localisation of 5 Hz whose last pose every row repeats."""
    last = np.arange(len(table["t"])) // int(RATE / 5.0) * int(RATE / 5.0)
    return {k: v[last] if k in POSE else v for k, v in table.items()}


def _moved_from(table: Table, row: int, shift: tuple[float, float, float]) -> Table:
    """The pose from a row on, turned about where it is there, and shifted."""
    out = {k: v.copy() for k, v in table.items()}
    dx, dy, turn = shift
    x, y = (table[k][row:] - table[k][row] for k in POSE[:2])
    out["pose.x"][row:] = table["pose.x"][row] + np.cos(turn) * x - np.sin(turn) * y + dx
    out["pose.y"][row:] = table["pose.y"][row] + np.sin(turn) * x + np.cos(turn) * y + dy
    out["pose.theta"][row:] += turn
    return out


def _corrections(rng: Rng, run: int, table: Table) -> Table:
    """A localisation that corrects itself once a run."""
    far, turn = rng.uniform(0.1, 0.3), rng.uniform(0.05, 0.2) * rng.choice([-1.0, 1.0])
    towards = rng.uniform(0.0, 2.0 * np.pi)
    shift = far * float(np.cos(towards)), far * float(np.sin(towards)), float(turn)
    return _moved_from(table, int(rng.uniform(4.0, SECONDS - 4.0) * RATE), shift)


def _carried(rng: Rng, run: int, table: Table) -> Table:
    """A robot that is stopped in one run, stands for 1 s, and is carried elsewhere within 1.5 s."""
    if run != 1:
        return table
    row, rest, on_the_way = int(rng.uniform(6.0, 12.0) * RATE), int(RATE), int(1.5 * RATE)
    way = np.concatenate([np.zeros(rest), 0.5 - 0.5 * np.cos(np.pi * np.arange(on_the_way) / on_the_way)])
    count = len(way)
    shift = 0.5, -0.3, 0.8
    later = _rows(_moved_from(table, row, shift), np.arange(len(table["t"])) >= row)
    amid = {k: np.full(count, v[row]) for k, v in table.items()}
    amid |= {k: np.zeros(count) for k in table if k.startswith(("command", "velocity"))}
    amid |= {k: table[k][row] + d * way + 0.002 * rng.standard_normal(count) for k, d in zip(POSE, shift, strict=True)}
    before = _rows(table, np.arange(len(table["t"])) < row)
    out = {k: np.concatenate([before[k], amid[k], later[k]]) for k in table}
    return out | {"t": np.arange(len(out["t"])) / RATE}


def _swapped(rng: Rng, run: int, table: Table) -> Table:
    """One run in which left and right were exchanged."""
    if run != 3:
        return table
    return table | {"command.left": table["command.right"], "command.right": table["command.left"]}


def _uneven(rng: Rng, run: int, table: Table) -> Table:
    """Stamps that are off by up to a third of a period."""
    return table | {"t": table["t"] + rng.uniform(0.0, 0.33, len(table["t"])) / RATE}


FAULTS = (
    Fault("none"),
    Fault("gaps", spoilt=_gaps),
    Fault("pose drops out", spoilt=_dropouts),
    Fault("pose freezes", spoilt=_freezes, lacking=True),
    Fault("slow pose, repeated", spoilt=_held),
    Fault("pose corrects itself", spoilt=_corrections, lacking=True),
    Fault("emergency stop", _stop, lacking=True),
    Fault("motors on late", _late, lacking=True),
    Fault("carried away", spoilt=_carried, lacking=True),
    Fault("wheels swapped in one run", spoilt=_swapped, lacking=True, mistaken="run4"),
    Fault("uneven stamps", spoilt=_uneven),
)


def make(fault: Fault, perfect: bool, seed: int, folder: Path) -> Mapping[tuple[str, str | None], float]:
    """Write robot.toml and the runs; the truth, a number each."""
    rng = np.random.default_rng([seed, perfect])
    ratio, delay = float(rng.uniform(1.04, 1.08)), float(np.round(rng.uniform(0.05, 0.1), 3))
    robot = Drive(RADIUS, TRACK) if perfect else Drive(RADIUS, TRACK, ratio=ratio, delay=delay)
    sensors = Sensors(RATE, noise=PoseNoise(0.003, 0.004), encoders=bool(seed % 2), encoder=0.02)
    write_drive(folder, RADIUS, TRACK)
    spoil = np.random.default_rng([seed, *fault.name.encode()])
    for n in range(RUNS):
        sent = drive(rng, str(rng.choice(["multisine", "steps", "arcs", "smooth"])), SECONDS, RATE, 8.0, False)
        table = logged(robot, sensors, fault.executed(spoil, n, sent), RATE, rng)
        rows = np.minimum((table["t"] * RATE + 1e-6).astype(int), len(sent) - 1)
        table |= {"command.left": sent[rows, 0], "command.right": sent[rows, 1]}
        write_run(folder, f"run{n + 1}", fault.spoilt(spoil, n, table))
    if perfect:
        return {}
    return {("wheel_radius_mismatch", None): ratio, ("command_delay", None): delay}


def diagnosed(fault: Fault, perfect: bool, seed: int) -> dict[str, Any]:
    """One row: what was planted, what was said, and whether that is right."""
    import residual_mpc as rm

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        truth = make(fault, perfect, seed, folder)
        robot = rm.load_robot(folder / "robot.toml")
        try:
            found = rm.diagnose(robot, rm.read_runs(robot, folder), seed=0)
        except BadInput as error:
            return {
                "fault": fault.name, "perfect": perfect, "seed": seed, "verdict": "refused",
                "right": bool(fault.mistaken) and fault.mistaken in str(error),
                "named": {}, "found": 0, "of": 0, "sizes": [], "wrong": 0.0,
            }  # fmt: skip
    named = {(e["effect"], e["target"]): e for e in found.document["explanation"]}
    groups = [{(m["effect"], m["target"]) for m in g if isinstance(m, dict)} for g in found.document["confounded"]]
    stands = {t: next((n for n in named if n == t or any({n, t} <= g for g in groups)), None) for t in truth}
    wrong = [e["probability"] for n, e in named.items() if n not in stands.values()]
    sizes = [_size(named[t], true) for t, true in truth.items() if t in named]
    expected = ("unknown",) if perfect and fault.lacking else ("no_gap",) if perfect else ("effects", "partial")
    return {
        "fault": fault.name, "perfect": perfect, "seed": seed, "verdict": found.document["verdict"],
        "right": found.document["verdict"] in expected and None not in stands.values() and not wrong,
        "named": {f"{e}{'' if t is None else f' ({t})'}": named[e, t]["probability"] for e, t in named},
        "found": sum(n is not None for n in stands.values()), "of": len(truth), "sizes": sizes,
        "wrong": max(wrong, default=0.0),
    }  # fmt: skip


def _size(effect: Mapping[str, Any], true: float) -> list[float]:
    """A number that was found, its interval, and the true one."""
    number = next(iter(effect["parameters"].values()))
    return [number["value"], *number["ci95"], true]


@click.command()
@click.option("--fault", "names", multiple=True, type=click.Choice([f.name for f in FAULTS]), help="[default: all]")
@click.option("--seeds", type=int, default=2, show_default=True, help="Pairs of rovers for each fault.")
@click.option("--first", type=int, default=0, show_default=True, help="First seed.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default=Path("build/spoilt-logs.json"))
def spoilt_logs(names: tuple[str, ...], seeds: int, first: int, out: Path) -> None:
    """Make, diagnose and score; resumes from `--out`."""
    rows: list[dict[str, Any]] = json.loads(out.read_text()) if out.exists() else []
    done = {(r["fault"], r["perfect"], r["seed"]) for r in rows}
    out.parent.mkdir(parents=True, exist_ok=True)
    for fault in (f for f in FAULTS if not names or f.name in names):
        for seed in range(first, first + seeds):
            for perfect in (True, False):
                if (fault.name, perfect, seed) not in done:
                    rows.append(diagnosed(fault, perfect, seed))
                    write_atomically(out, json.dumps(rows, indent=1))
                    click.echo(line(rows[-1]))


def line(row: Mapping[str, Any]) -> str:
    """One row of the table."""
    named = ", ".join(f"{name} {p:.2f}" for name, p in row["named"].items())
    sizes = "; ".join(f"{s[0]:.3g} ({s[1]:.3g} to {s[2]:.3g}), true {s[3]:.3g}" for s in row["sizes"])
    robot = "perfect" if row["perfect"] else "mismatch, delay"
    return f"| {row['fault']} | {robot} | {row['seed']} | {row['verdict']} | {named} | {sizes} | {row['right']} |"


if __name__ == "__main__":
    spoilt_logs()
