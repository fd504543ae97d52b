"""`python -m benchmarks.watch`: how often `watch` raises a false alarm, and how fast it sees a change.

Each robot drives for hours without a change, from the findings' simulator, which shares no law with the product: a
wider track than modelled, slip that is correlated in time, coloured noise of the pose. Its first five minutes are the
reference, and the rest is tested. In one set of robots the track also drifts by 1 % over minutes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import residual_mpc as rm
from benchmarks.findings.motions import drive
from benchmarks.findings.noise import PoseNoise, ar1
from benchmarks.findings.records import write_drive
from benchmarks.findings.wheels import STEP, Drive, Sensors, moved, rolled
from residual_mpc.monitoring.settings import WatchSettings

RATE = 20.0  # Hz
PIECE = 40.0  # s of one kind of motion
KINDS = ("multisine", "smooth", "steps")
SENSORS = Sensors(rate=RATE, noise=PoseNoise(0.002, 0.004, 0.003, 0.004, 0.9), encoders=True, encoder=0.02)
CHANGES = {
    "track 1.02": {"track_scale": 1.02}, "track 1.05": {"track_scale": 1.05}, "track 1.10": {"track_scale": 1.10},
    "right wheel 1.02": {"ratio": 1.02}, "delay 30 ms": {"delay": 0.03}, "delay 80 ms": {"delay": 0.08},
}  # fmt: skip


@dataclass(frozen=True)
class Setting:
    """drift: standard deviation of the track's slow variation, relative."""

    name: str
    robot: Drive
    drift: float = 0.0


SETTINGS = (
    Setting("steady", Drive(0.05, 0.30, track_scale=1.06, slip=0.02)),
    Setting("track drifts by 1 % over minutes", Drive(0.05, 0.30, track_scale=1.06, slip=0.02), 0.01),
)


def hour(setting: Setting, seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Commands (n, 2), wheel speeds (steps, 2) and poses (steps + 1, 3) of `seconds` s of driving, at 1 ms."""
    kinds = [KINDS[k] for k in rng.integers(len(KINDS), size=int(np.ceil(seconds / PIECE)))]
    commands = np.concatenate([drive(rng, kind, PIECE, RATE, 8.0) for kind in kinds])[: int(seconds * RATE)]
    if not setting.drift:
        return commands, *moved(setting.robot, commands, RATE, rng)
    robot = replace(setting.robot, slip=0.0)
    w, _ = moved(robot, commands, RATE, rng)
    slow = np.repeat(ar1(rng, (int(seconds) + 1,), float(np.exp(-1.0 / 120.0))), round(1 / STEP))[: len(w)]
    ground = robot.wheel_radius * w * (1 + setting.robot.slip * ar1(rng, w.shape, float(np.exp(-STEP / 0.3))))
    turn = 1.0 + setting.drift * slow[:, None]
    forward, half = ground.mean(axis=1, keepdims=True), 0.5 * (ground[:, 1:] - ground[:, :1]) / turn
    return commands, w, rolled(np.hstack([forward - half, forward + half]), robot.track_width * robot.track_scale)


def table(setting: Setting, seconds: float, rng: np.random.Generator, at: float = 0.0) -> tuple[str, list[str]]:
    """Header and lines of a log that begins at `at` s."""
    commands, w, pose = hour(setting, seconds, rng)
    rows = np.arange(0, len(w), round(1 / RATE / STEP))
    read = SENSORS.noise.added(rng, pose[rows])
    speeds = w[rows] + SENSORS.encoder * rng.standard_normal((len(rows), 2))
    values = np.column_stack([at + rows * STEP, commands[: len(rows)], read, speeds])
    lines = [",".join(f"{v:.5f}" for v in row) for row in values]
    return "t,command.left,command.right,pose.x,pose.y,pose.theta,velocity.left,velocity.right", lines


def write_log(path: Path, parts: Sequence[tuple[Setting, float]], rng: np.random.Generator) -> None:
    """One log per part, one after the other."""
    for number, (setting, seconds) in enumerate(parts):
        header, lines = table(setting, seconds, rng)
        (path / f"part{number:03d}.csv").write_text("\n".join([header, *lines]) + "\n")


def write_example(folder: Path, change: dict[str, float], before: float, after: float, seed: int) -> None:
    """robot.toml and logs/: a robot for `before` s, then for `after` s with the change."""
    rng = np.random.default_rng([seed, 99])
    steady = SETTINGS[0]
    factor = {k: v * getattr(steady.robot, k) if k != "delay" else v for k, v in change.items()}
    write_drive(folder, 0.05, 0.30)
    (folder / "logs").mkdir()
    changed = Setting("changed", replace(steady.robot, **factor))
    write_log(folder / "logs", [(steady, before), (changed, after)], rng)


def events(folder: Path, reference: float, seed: int) -> Iterator[dict[str, object]]:
    from residual_mpc.monitoring.events import document_of

    robot = rm.load_robot(folder / "robot.toml")
    settings = WatchSettings(learn=reference, every=60.0)
    for event in rm.watch(robot, folder / "logs", once=True, seed=seed, settings=settings):
        if event is not None:
            yield document_of(event)


def false_alarms(setting: Setting, robots: int, hours: int, reference: float, seed: int) -> tuple[int, float]:
    """Changes that were told, and hours of testing. A change ends its robot's run."""
    alarms, tested = 0, 0.0
    for k in range(robots):
        rng = np.random.default_rng([seed, k])
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_drive(folder, 0.05, 0.30)
            (folder / "logs").mkdir()
            write_log(folder / "logs", [(setting, 3600.0)] * hours, rng)
            for event in events(folder, reference, k):
                if event["event"] == "gap":
                    tested += 60.0 / 3600.0
                if event["event"] == "change":
                    alarms += 1
                    print(f"    robot {k}: alarm after {tested:.1f} h in all: {event}", file=sys.stderr)
                    break
        counted = f"{k + 1} robots, {tested:.1f} h, {alarms} alarms"
        print(f"  {setting.name}: {counted}", file=sys.stderr, flush=True)
    return alarms, tested


def detected(name: str, change: dict[str, float], reference: float, seed: int) -> str:
    """One robot whose number changes after its reference and ten more minutes, and what is said of it."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_example(folder, change, reference + 600.0, 600.0, seed)
        told, since, said = "not found in 10 min", "", ""
        for event in events(folder, reference, seed):
            if event["event"] == "change":
                at, begun = event["at"], event["since"]
                early = at["run"] != "part001"  # type: ignore[index]
                told = "FALSE ALARM" if early else f"{at['t']:.0f} s"  # type: ignore[index]
                since = f"{begun['run']} {begun['t']:.0f} s"  # type: ignore[index]
            if event["event"] == "cause":
                said = str(event["sentence"])
    return f"| {name} | {told} | {since} | {said} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--hours", type=int, default=10)
    parser.add_argument("--reference", type=float, default=600.0, help="s")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=["alarms", "changes"])
    given = parser.parse_args()
    if given.only != "changes":
        print("| robots | hours tested | false alarms |\n| --- | --- | --- |")
        for setting in SETTINGS:
            alarms, hours = false_alarms(setting, given.robots, given.hours, given.reference, given.seed)
            print(f"| {setting.name} | {hours:.0f} | {alarms} |", flush=True)
    if given.only != "alarms":
        print("\n| change | told after | since (true: part001 0 s) | said |")
        print("| --- | --- | --- | --- |")
        for name, change in CHANGES.items():
            print(detected(name, change, given.reference, given.seed), flush=True)


if __name__ == "__main__":
    main()
