"""One case on one seed, both tools on the same files; kept as JSON, so that an interrupted sweep resumes."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.head_to_head.files import HIDDEN, TIMESTEP, write_case
from benchmarks.head_to_head.ours import Diagnosed, Judged, diagnose, judge
from benchmarks.head_to_head.servo import TUNED, Servo
from benchmarks.head_to_head.toolbox import Fit, fit


@dataclass(frozen=True)
class Match:
    """fits: by what the toolbox was told: "nothing", "delay", "payload"; "sensor": nothing, and compared by a sensor.

    truth: the servo that was drawn; given: the guess that both tools start from; code: the version of the project.
    """

    case: str
    seed: int
    truth: Servo
    given: Servo
    fits: dict[str, Fit]
    diagnosed: Diagnosed
    judged: Judged
    code: str


def play(case: str, seed: int, place: Path, code: str, say: Callable[[str], None]) -> Match:
    """Make the case in its own folder of `place`, run both tools, judge; code: the version that is measured."""
    folder = place / f"{case}_{seed}"
    kept = folder / "match.json"
    if kept.is_file():
        return read(kept)
    say(f"{case}, seed {seed}: mujoco.sysid")
    truth, given = write_case(case, seed, folder)
    fits = {"nothing": fit(folder, given, None, report=folder / "toolbox")}
    if case in HIDDEN:
        fits[case] = fit(folder, given, case)
    else:
        fits["sensor"] = fit(folder, given, None, "sensor")
    say(f"{case}, seed {seed}: residual-mpc diagnose")
    diagnosed = diagnose(folder, given)
    names = [*TUNED, case] if case in HIDDEN else [*TUNED]
    models = {"true": {name: getattr(truth, name) for name in names}}
    models |= {f"told_{told}": alone(f.values) for told, f in fits.items() if told != "sensor"}
    judged = judge(folder, models, folder / "diagnosis" / "diagnosis.json")
    match = Match(case, seed, truth, given, fits, diagnosed, judged, code)
    kept.write_text(json.dumps(asdict(match), indent=2) + "\n")
    return match


def alone(values: Mapping[str, float]) -> dict[str, float]:
    """The toolbox's values with its delay as a dead time alone.

    Its linear history turns a held command into a ramp that leads by half a step, which its delay makes up for.
    """
    return {name: value - 0.5 * TIMESTEP if name == "delay" else value for name, value in values.items()}


def read(path: Path) -> Match:
    """A match that was kept."""
    d = json.loads(path.read_text())
    said = d["diagnosed"]
    said["intervals"] = {k: (v[0], v[1]) for k, v in said["intervals"].items()}
    fits = {told: Fit(**f) for told, f in d["fits"].items()}
    return Match(
        d["case"],
        d["seed"],
        Servo(**d["truth"]),
        Servo(**d["given"]),
        fits,
        Diagnosed(**said),
        Judged(**d["judged"]),
        d["code"],
    )
