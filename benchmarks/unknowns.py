"""How often a fitted law, or else `remainder`, names the right dependence, and how much a fitted law closes, on blind
cases whose cause no library holds.

residual-mpc blind make --out unknowns --family wheeled=16 --level unknown --seed 7100
residual-mpc blind run unknowns --out unknowns-results
python -m benchmarks.unknowns unknowns-results --answers unknowns-answers
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

# What the remainder depends on, by its cause; gusts and jumps of a map come when they come, and nothing that is logged
# tells. The last eight are drawn for test seeds alone.
RIGHT = {
    "one_sided_turning": ("turning",),
    "warming_up": ("time", "work"),
    "dented_tooth": ("position", "angle"),
    "dragging_cable": ("position",),
    "warming_friction": ("time", "work"),
    "gusts": (),
    "drifting_gyro": ("time",),
    "relocations": (),
    "flipping_castor": ("direction",),
    "carpet_nap": ("heading",),
    "magnetic_heading": ("heading",),
    "hot_motors": ("work", "time"),
    "uneven_friction": ("angle", "position"),
    "belt_between_joints": ("speed",),
    "crossed_encoders": ("position",),
    "shared_supply": ("work", "command", "load"),
}
CLOSED = 0.6  # of the gap on runs that no fit has seen: the goal for what a fitted law removes
# a quantity by its words, the more telling first
WORDS = {"turning": "turning", "angle": "angle", "load": "load", "time": "time", "command": "command",
         "position": "position", "speed": "speed"}  # fmt: skip
NAMED_LAWS = {"torque_ripple": "angle", "joint_spring": "position", "wheel_eccentricity": "wheel_angle"}


def right(cause: str, depends: Sequence[str]) -> bool:
    """Whether the first of the dependences (kinds) is the cause's, or there is none where there should be none."""
    return depends[0] in RIGHT[cause] if depends and RIGHT[cause] else not depends and not RIGHT[cause]


def laws(explanation: Sequence[Mapping[str, Any]]) -> list[str]:
    """The quantities of the laws in an explanation: fitted ones, and effects that are a law of a position."""
    out = []
    for entry in explanation:
        if entry["effect"] == "fitted_law":
            words = str(entry["on"]).split()
            out.append(next((kind for word, kind in WORDS.items() if word in words), "other"))
        elif entry["effect"] in NAMED_LAWS:
            out.append(NAMED_LAWS[entry["effect"]])
    return out


@click.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--answers", type=click.Path(path_type=Path, exists=True, file_okay=False), required=True)
def unknowns(results: Path, answers: Path) -> None:
    """A line a case, and the counts by cause; for causes that depend on a quantity, what laws close."""
    counts: Counter[str] = Counter()
    good: Counter[str] = Counter()
    lawful: Counter[str] = Counter()
    for path in sorted(results.glob("*/diagnosis.json")):
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        answer = json.loads((answers / f"{path.parent.name}.json").read_text(encoding="utf-8"))["answer"]
        (cause,) = answer["unknown"]
        rest, kinds = found["remainder"], laws(found["explanation"])
        closed = (found["shrink"] or {"value": 0.0})["value"]
        if RIGHT[cause]:
            lawful["cases"] += 1
            lawful["closed"] += bool(kinds) and closed >= CLOSED
            lawful["laws"] += bool(kinds)
            lawful["right"] += bool(kinds) and all(kind in RIGHT[cause] for kind in kinds)
        else:
            lawful["none"] += 1
            lawful["false"] += bool(kinds)
        depends = kinds + [d["kind"] for d in rest["depends_on"]] if rest else kinds
        counts[cause] += 1
        good[cause] += right(cause, depends)
        said = rest["sentence"] if rest else "nothing is left to describe"
        mark = "right" if right(cause, depends) else "WRONG"
        click.echo(f"{path.parent.name} {cause} {found['verdict']}: {mark}. {said}")
        left = found["unexplained"]["share"]
        of = ", ".join(kinds) or "nothing"
        click.echo(f"  laws of {of}; {closed:.0%} of the gap closed, {1.0 - left:.0%} of its squares beyond the noise")
    for cause, n in sorted(counts.items()):
        click.echo(f"{cause}: {good[cause]} of {n}")
    click.echo(
        f"with a law, {CLOSED:.0%} closed: {lawful['closed']} of {lawful['cases']} whose cause depends on a quantity; "
        f"right quantity, all laws: {lawful['right']} of {lawful['laws']} with a law; laws where nothing logged is the "
        f"cause: {lawful['false']} of {lawful['none']}"
    )


if __name__ == "__main__":
    unknowns()
