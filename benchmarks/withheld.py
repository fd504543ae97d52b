"""Real data, withheld: what a diagnosis of recorded robots was not told, what it said beforehand, and what came.

python -m benchmarks.recorded --row NAME ...       (measures; takes minutes a row)
python -m benchmarks.withheld [--keep build/recorded] [--page FILE]

The page is written from what `benchmarks.recorded` measured and kept; a row that is not there says so.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from benchmarks.recorded.words import inside, named_of


@dataclass(frozen=True)
class Withheld:
    """row: of `benchmarks.recorded`. kept: what was withheld. true: what is known of it, by (effect, parameter), in its
    unit, with where from."""

    row: str
    title: str
    kept: str
    true: Mapping[tuple[str, str], tuple[float, str]] = field(default_factory=dict)


CASES = (
    Withheld(
        "xl330, half the mass",
        "Half of the mass of the XL330's load",
        "The experimenters hung 0.49 kg on the servo. The model was told 0.245 kg, and nothing of friction, which it "
        "lacks as well. Four of the sixteen runs were held out.",
        {("payload", "mass"): (0.245, "the mass that was taken out of the model")},
    ),
    Withheld(
        "xl330, motor off",
        "The XL330 with its motor off",
        "The four runs in which the load is lifted and dropped: for three quarters of their rows the motor is off and "
        "the arm swings free. The twelve runs in which it is on throughout were fitted. No other recording has the "
        "motor off.",
    ),
    Withheld(
        "husky_terrain, new ground",
        "The Husky's ground",
        "All seven runs on asphalt. The eight on indoor flooring were fitted; the model knows no ground.",
        {
            ("actuator_gain", "gain"): (0.58, "yaw over ideal, on the held-out asphalt"),
            ("track_width", "scale"): (1.0 / 0.58, "ideal yaw over yaw, on the held-out asphalt"),
        },
    ),
    Withheld(
        "husky_drive",
        "The Husky's turns and its skidding",
        "The diagnosis was not told the limit of its turns, nor how little the robot turns for the "
        "motion of its wheels. A quarter of its 402 runs was held out.",
        {
            ("turn_limit", "limit"): (3.08, "half the difference of its wheels' speeds in steady fast turns"),
            ("track_width", "scale"): (2.6, "yaw of the encoders over yaw"),
        },
    ),
    Withheld(
        "so101",
        "Motions of the SO-101",
        "Nine of 35 motions, drawn from all ranks of the nominal gap; among them the one in which the wrist's "
        "roll meets a stop that the model lacks. Nobody knows the cause for certain: the test is the gap on motions "
        "that were not seen.",
    ),
    *(
        Withheld(
            f"so101, fourth {k}",
            f"Motions of the SO-101, fourth {k}",
            "Every fourth motion by name. In these four diagnoses each motion is held out once.",
        )
        for k in (1, 2, 3, 4)
    ),
)

HEAD = """\
# Real data, withheld

What a diagnosis of [recorded robots](recorded.md) was not told, what it said before the held-out windows were
evaluated, and what was achieved. Written by `python -m benchmarks.withheld --page docs/results/withheld.md` from what
`python -m benchmarks.recorded` measured; each section names the commit it was measured at. Brackets contain 95 %
intervals.

| withheld | verdict | shrink expected | achieved | inside |
| --- | --- | --- | --- | --- |
"""


@click.command()
@click.option("--keep", type=click.Path(path_type=Path, file_okay=False), default=Path("build/recorded"),
              show_default=True, help="Where `benchmarks.recorded` keeps its diagnoses.")  # fmt: skip
@click.option("--page", type=click.Path(path_type=Path, dir_okay=False), help="[default: stdout]")
def withheld(keep: Path, page: Path | None) -> None:
    """Write the page."""
    found = [(case, measured(case, keep)) for case in CASES]
    text = HEAD + "".join(line(c, m) for c, m in found) + "\n" + "\n".join(section(c, m) for c, m in found)
    if page is None:
        click.echo(text)
    else:
        page.write_text(text, encoding="utf-8")


def measured(case: Withheld, keep: Path) -> dict[str, Any] | None:
    """What the row came to, with its command and commit; None where it was not measured."""
    path = keep / re.sub(r"\W+", "-", case.row) / "measured.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def line(case: Withheld, found: dict[str, Any] | None) -> str:
    """The case in the table."""
    if found is None:
        return f"| {case.title} | not measured | | | |\n"
    d = found["document"]
    shrink = d["shrink"]
    if not shrink:
        return f"| {case.title} | `{d['verdict']}` | none | | |\n"
    held = "yes" if inside(shrink["value"], shrink["expected_ci95"]) else "**no**"
    expected = f"{shrink['expected']:.0%} {span(shrink['expected_ci95'])}"
    return f"| {case.title} | `{d['verdict']}` | {expected} | {shrink['value']:.0%} | {held} |\n"


def section(case: Withheld, found: dict[str, Any] | None) -> str:
    """What was withheld, said, and came; what of it was right and what was wrong."""
    head = f"## {case.title}\n\n**Withheld.** {case.kept}\n\n"
    if found is None:
        command = f'python -m benchmarks.recorded --row "{case.row}"'
        return f"{head}Not measured with this version: `{command}` does that ([earlier](recorded.md)).\n"
    d = found["document"]
    right, wrong = marks(case, d)
    told = [f"```\n{found['shown']}\n```\n", f"**Expected**{found['code']}**.** {beforehand(d)}\n"]
    told.append(f"**Achieved.** {came(d)}\n")
    told += [f"**Right.** {' '.join(right)}\n"] if right else []
    told += [f"**Wrong.** {' '.join(wrong)}\n"] if wrong else []
    return head + "\n".join(told)


def beforehand(d: dict[str, Any]) -> str:
    """The verdict, the named effects and the shrink that was stated."""
    named = "; ".join(f"{named_of(c)} {numbers(c)}, probability {c['probability']:.2f}" for c in d["explanation"])
    groups = "".join(
        f" On these runs {', '.join(str(named_of(m)) for m in g if isinstance(m, dict))} cannot be told apart."
        for g in d["confounded"]
    )
    shrink = d["shrink"]
    size = f" A shrink of {shrink['expected']:.0%} {span(shrink['expected_ci95'])}." if shrink else ""
    return f"`{d['verdict']}`{': ' + named if named else ''}.{groups}{size}"


def came(d: dict[str, Any]) -> str:
    """The gap on what was kept back, and what is left of it."""
    gap, shrink = d["gap"], d["shrink"]
    size = f", a shrink of {shrink['value']:.0%} {span(shrink['ci95'])}" if shrink else ""
    rest = d.get("remainder")
    left = f" {rest['sentence']}" if rest else ""
    return (
        f"On {gap['windows']} windows that no fit has seen the gap went from {gap['before']:.3f} to {gap['after']:.3f} "
        f"(noise floor {gap['noise_floor']:.2g}){size}; {d['unexplained']['share']:.0%} of its square beyond the floor "
        f"is left.{left}"
    )


def marks(case: Withheld, d: dict[str, Any]) -> tuple[list[str], list[str]]:
    """What of what was said is right, and what is wrong, as far as it is known."""
    right: list[str] = []
    wrong: list[str] = []
    shrink = d["shrink"]
    if shrink:
        held = inside(shrink["value"], shrink["expected_ci95"])
        (right if held else wrong).append(f"The shrink lies {'inside' if held else 'outside'} its interval.")
    else:
        wrong.append("No shrink could be expected.")
    named = {(c["effect"], p): q for c in d["explanation"] for p, q in c["parameters"].items()}
    grouped = {m["effect"] for g in d["confounded"] for m in g if isinstance(m, dict)}
    for (effect, parameter), (true, whence) in case.true.items():
        q = named.get((effect, parameter))
        if q is None:
            if effect in grouped:
                right.append(f"`{effect}` is among the members of its group.")
            elif len(case.true) == 1 or not any((e, p) in named for e, p in case.true):
                wrong.append(f"`{effect}` is not named.")
            continue
        held = inside(true, q["ci95"])
        text = f"{parameter} of `{effect}`: {q['value']:.3g} {span(q['ci95'], '.3g')} against {true:.3g} ({whence})."
        (right if held else wrong).append(text)
    return right, wrong


def numbers(cause: dict[str, Any]) -> str:
    """A cause's parameters with their intervals."""
    said = []
    for name, p in cause["parameters"].items():
        unit = "" if p["unit"] == "1" else f" {p['unit']}"
        said.append(f"{name} {p['value']:.3g}{unit} {span(p['ci95'], '.3g')}")
    return ", ".join(said)


def span(interval: list[float], form: str = ".0%") -> str:
    """(33% to 83%)."""
    low, high = interval
    return f"({low:{form}} to {high:{form}})"


if __name__ == "__main__":
    withheld()
