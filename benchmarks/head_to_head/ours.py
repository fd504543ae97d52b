"""The side of `residual-mpc`: `diagnose` as a user calls it, and `gap` as the judge of every model."""

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.head_to_head.files import FIELD, HIDDEN, JOINT, write_model
from benchmarks.head_to_head.servo import Servo


@dataclass(frozen=True)
class Diagnosed:
    """What a diagnosis said.

    values: retuned parameters and hidden effects by our names; intervals: 95 % of the effects alone, retuned values
    have none; probability: of each effect; groups: effects that it cannot tell apart; beside: other effects it named.
    """

    verdict: str
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    probability: dict[str, float]
    groups: list[list[str]]
    beside: list[str]
    seconds: float


def diagnose(folder: Path, given: Servo) -> Diagnosed:
    """Diagnose the runs of a case in a process of its own; the report stays in its folder `diagnosis`.

    Raises RuntimeError where the command fails.
    """
    out = folder / "diagnosis"
    words = ["diagnose", "--robot", str(folder / "robot.toml"), str(folder / "runs"), "--out", str(out), "--json"]
    begin = perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "residual_mpc.cli.main", *words], capture_output=True, text=True, check=False
    )
    seconds = perf_counter() - begin
    if done.returncode:
        raise RuntimeError(f"residual-mpc {' '.join(words)} ended with {done.returncode}: {done.stderr[-400:]}")
    return understand(json.loads(done.stdout), given, seconds)


def understand(document: Mapping[str, Any], given: Servo, seconds: float) -> Diagnosed:
    """A diagnosis.json by our names; what it left alone keeps its guess."""
    ours = {f"joint.{JOINT}.{field}": name for name, field in FIELD.items()}
    values = {name: float(getattr(given, name)) for name in FIELD}
    values |= {ours[v["parameter"]]: v["value"] for v in document["model"]["values"] if v["effect"] == "tune"}
    names = {effect: (name, parameter) for name, (effect, parameter) in HIDDEN.items()}
    intervals: dict[str, tuple[float, float]] = {}
    probability: dict[str, float] = {}
    beside = []
    for cause in document["explanation"]:
        if cause["effect"] not in names:
            beside.append(cause["effect"])
            continue
        name, parameter = names[cause["effect"]]
        found = cause["parameters"][parameter]
        values[name] = found["value"]
        intervals[name] = (found["ci95"][0], found["ci95"][1])
        probability[name] = cause["probability"]
    groups = [[" + ".join(t["effect"] for t in (m if isinstance(m, list) else [m])) for m in group]
              for group in document["confounded"]]  # fmt: skip
    return Diagnosed(document["verdict"], values, intervals, probability, groups, beside, seconds)


@dataclass(frozen=True)
class Judged:
    """Gaps over 1 s on runs that nobody has seen (contract, section 4), by whose values the model carries."""

    gaps: dict[str, float]
    noise_floor: float


def judge(folder: Path, models: Mapping[str, Mapping[str, float]], diagnosis: Path) -> Judged:
    """The gap of the guess, of models given by our names, and of a diagnosis, on the fresh runs of a case."""
    import residual_mpc as rm

    robot = rm.load_robot(folder / "robot.toml")
    fresh = rm.read_runs(robot, folder / "fresh")
    paths = {name: write_model(values, folder / f"model_{name}.json") for name, values in models.items()}
    gaps: dict[str, float] = {}
    floor = 0.0
    for name, path in {**paths, "diagnosed": diagnosis}.items():
        found = rm.measure_gap(robot, fresh, model=path).document
        gaps["guess"], gaps[name] = found["nominal"], found["model"]
        floor = found["noise_floor"] if name == "true" else floor
    return Judged(gaps, floor)
