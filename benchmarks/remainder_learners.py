"""What the learners remove of the gap that a diagnosis leaves, on blind cases.

residual-mpc blind make --out left --family wheeled=4 --level single --level unknown --level withheld --seed 3100
residual-mpc blind run left --out left-results
python -m benchmarks.remainder_learners left-results --answers left-answers

A learner is run where the gap that is left is clearly above the noise floor. The windows that choose it are not those
that it is judged on.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import click


@click.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--answers", type=click.Path(path_type=Path, exists=True, file_okay=False), required=True)
def remainder_learners(results: Path, answers: Path) -> None:
    """Print a row for each level, or for each cause without a name."""
    found = []
    for path in sorted(results.glob("*/diagnosis.json")):
        answer = json.loads((answers / f"{path.parent.name}.json").read_text(encoding="utf-8"))["answer"]
        planted = ", ".join(answer["unknown"]) or answer["level"]
        found.append((planted, json.loads(path.read_text(encoding="utf-8"))))
    click.echo("| planted | cases | no learner run | nothing chosen | ridge | network | removed, % |")
    click.echo("| --- | --- | --- | --- | --- | --- | --- |")
    for planted in sorted({p for p, _ in found}):
        click.echo(row(planted, (d for p, d in found if p == planted)))


def row(planted: str, diagnoses: Iterable[Mapping[str, Any]]) -> str:
    """Counts by what was chosen, and the shrinks of the remaining gap where a learner was."""
    counts = dict.fromkeys(("not run", "nothing", "ridge", "network"), 0)
    removed = []
    for d in diagnoses:
        by = d["learned"]["by"]
        counts[by or ("nothing" if d["learned"]["asked"] else "not run")] += 1
        if by:
            removed.append(f"{100 * d['unexplained']['learned_residual_shrink']:.0f}")
    return f"| {planted} | {sum(counts.values())} | {' | '.join(map(str, counts.values()))} | {', '.join(removed)} |"


if __name__ == "__main__":
    remainder_learners()
