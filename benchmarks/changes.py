"""Changes of known size in simulated rovers, compared and scored: what was named, and with which size.

python -m benchmarks.changes [--kind NAME ...] [--seeds 3] [--first 0] [--out build/changes.json]

The rovers are those of the benchmark of findings (an ODE of their own at 1 ms) and differ from their model in radius,
track, delay, lag, a slip that wanders and a radius that grows with speed; delay, lag and radii differ a little from
run to run. Five runs of 18 s before and five after, other motions each time; odd seeds have encoders.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.findings.motions import Rng, drive
from benchmarks.findings.noise import PoseNoise
from benchmarks.findings.records import write_drive, write_run
from benchmarks.findings.wheels import Drive, Sensors, logged
from residual_mpc.files import write_atomically

RADIUS, TRACK = 0.05, 0.2  # m
RUNS, SECONDS, RATE = 5, 18.0, 25.0  # runs a set, s, Hz


@dataclass(frozen=True)
class Planted:
    """factors and sums: of the robot's numbers after the change; truth: (effect, target) -> (parameter, change)."""

    name: str
    truth: Mapping[tuple[str, str | None], tuple[str, float]]
    factors: Mapping[str, float]
    sums: Mapping[str, float]
    gain: tuple[float, float] = (1.0, 1.0)
    limit: float = np.inf


KINDS = (
    Planted("none", {}, {}, {}),
    Planted("delay", {("command_delay", None): ("delay", 0.04)}, {}, {"delay": 0.04}),
    Planted("lag", {("actuator_lag", None): ("time_constant", 0.08)}, {}, {"lag": 0.08}),
    Planted("mismatch", {("wheel_radius_mismatch", None): ("ratio", 1.03)}, {"ratio": 1.03}, {}),
    Planted("radius", {("wheel_radius", None): ("scale", 0.95)}, {"scale": 0.95}, {}),
    Planted("track", {("track_width", None): ("scale", 1.1)}, {"track_scale": 1.1}, {}),
    Planted("limit", {("saturation", None): ("limit", 6.0)}, {}, {}, limit=6.0),
    Planted("left gain", {("actuator_gain", "left"): ("gain", 0.9)}, {}, {}, gain=(0.9, 1.0)),
    Planted(
        "delay and mismatch",
        {("command_delay", None): ("delay", 0.03), ("wheel_radius_mismatch", None): ("ratio", 1.05)},
        {"ratio": 1.05},
        {"delay": 0.03},
    ),
)


def make(kind: Planted, seed: int, folder: Path) -> None:
    """Write robot.toml, before/ and after/."""
    rng = np.random.default_rng([seed, *kind.name.encode()])
    robot = Drive(
        RADIUS, TRACK, scale=rng.uniform(0.93, 1.07), ratio=rng.uniform(0.97, 1.03), track_scale=rng.uniform(1.0, 1.3),
        delay=rng.uniform(0.0, 0.1), lag=rng.uniform(0.05, 0.15), growth=0.002, slip=0.03,
    )  # fmt: skip
    noise = PoseNoise(rng.uniform(0.002, 0.005), rng.uniform(0.003, 0.008))
    sensors = Sensors(50.0, noise=noise, encoders=bool(seed % 2), encoder=0.02)
    write_drive(folder, RADIUS, TRACK)
    for side in ("before", "after"):
        (folder / side).mkdir()
        for n in range(RUNS):
            now = _varied(robot, rng)
            sent = drive(rng, str(rng.choice(["multisine", "steps", "arcs", "smooth"])), SECONDS, RATE,
                         rng.uniform(7.0, 9.0), False)  # fmt: skip
            write_run(folder / side, f"{side}{n}",
                      logged(_changed(now, kind) if side == "after" else now, sensors, sent, RATE, rng))  # fmt: skip


def _varied(robot: Drive, rng: Rng) -> Drive:
    """What differs from run to run."""
    return replace(
        robot,
        ratio=robot.ratio * (1.0 + 0.002 * rng.standard_normal()),
        delay=max(0.0, robot.delay + 0.003 * rng.standard_normal()),
        lag=robot.lag * (1.0 + 0.03 * rng.standard_normal()),
    )


def _changed(robot: Drive, kind: Planted) -> Drive:
    numbers = {k: getattr(robot, k) * x for k, x in kind.factors.items()}
    numbers |= {k: getattr(robot, k) + x for k, x in kind.sums.items()}
    return replace(robot, limit=kind.limit, gain_after=kind.gain, changes_at=0.0, **numbers)


def compared(kind: Planted, seed: int) -> dict[str, Any]:
    """One row: what was planted, what was said, and whether that is right."""
    import residual_mpc as rm

    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        make(kind, seed, folder)
        robot = rm.load_robot(folder / "robot.toml")
        found = rm.compare(robot, rm.read_runs(robot, folder / "before"), rm.read_runs(robot, folder / "after"))
    named = {(c["effect"], c["target"]): c for c in found.changes}
    groups = [{(m["effect"], m["target"]) for m in g} for g in found.document["confounded"]]
    stands = {t: next((n for n in named if n == t or any({n, t} <= g for g in groups)), None) for t in kind.truth}
    sizes = {t[0]: _size(named[t]["parameters"][name], true) for t, (name, true) in kind.truth.items() if t in named}
    wrong = [c["probability"] for t, c in named.items() if t not in stands.values()]
    exact = set(named) == set(kind.truth) and (bool(kind.truth) or found.verdict == "same")
    right = exact or (bool(kind.truth) and len(named) == len(kind.truth) and None not in stands.values())
    return {
        "kind": kind.name, "seed": seed, "verdict": found.verdict, "right": right, "exact": exact,
        "named": [f"{e}{'' if t is None else f' ({t})'}" for e, t in named], "sizes": sizes,
        "sure_and_wrong": max(wrong, default=0.0),
        "gap": [found.gap[k] for k in ("before", "after", "after_explained", "noise_floor")],
    }  # fmt: skip


def _size(number: Mapping[str, Any], true: float) -> list[float]:
    """The change that was found, its interval, and the true one."""
    return [number["change"]["value"], *number["change"]["ci95"], true]


@click.command()
@click.option("--kind", "names", multiple=True, type=click.Choice([k.name for k in KINDS]), help="[default: all]")
@click.option("--seeds", type=int, default=3, show_default=True, help="Rovers of each kind.")
@click.option("--first", type=int, default=0, show_default=True, help="First seed.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), default=Path("build/changes.json"))
def changes(names: tuple[str, ...], seeds: int, first: int, out: Path) -> None:
    """Make, compare and score; resumes from `--out`."""
    rows: list[dict[str, Any]] = json.loads(out.read_text()) if out.exists() else []
    done = {(r["kind"], r["seed"]) for r in rows}
    out.parent.mkdir(parents=True, exist_ok=True)
    for kind in (k for k in KINDS if not names or k.name in names):
        for seed in range(first, first + seeds):
            if (kind.name, seed) not in done:
                rows.append(compared(kind, seed))
                write_atomically(out, json.dumps(rows, indent=1))
                click.echo(line(rows[-1]))
    click.echo(summary(rows))


def line(row: dict[str, Any]) -> str:
    """One row of the table."""
    sizes = "; ".join(f"{s[0]:.3g} ({s[1]:.3g} to {s[2]:.3g}), true {s[3]:.3g}" for s in row["sizes"].values())
    mark = "right" if row["exact"] else "right by a group" if row["right"] else "wrong"
    return f"| {row['kind']} | {row['seed']} | {row['verdict']} | {', '.join(row['named'])} | {sizes} | {mark} |"


def summary(rows: list[dict[str, Any]]) -> str:
    """The rates."""
    none = [r for r in rows if r["kind"] == "none"]
    some = [r for r in rows if r["kind"] != "none"]
    sizes = [s for r in some for s in r["sizes"].values()]
    inside = sum(low <= true <= high for _, low, high, true in sizes)
    highest = max([r["sure_and_wrong"] for r in rows], default=0.0)
    return "; ".join(
        (
            f"`same` of untouched robots: {sum(r['verdict'] == 'same' for r in none)} of {len(none)}",
            f"right: {sum(r['right'] for r in some)} of {len(some)} (exact {sum(r['exact'] for r in some)})",
            f"`same` although changed: {sum(r['verdict'] == 'same' for r in some)}",
            f"true size inside its interval: {inside} of {len(sizes)}",
            f"highest probability of a wrong change: {highest:.2f}",
        )
    )


if __name__ == "__main__":
    changes()
