"""One change of a known size in a real robot's runs, named by `compare`.

python -m benchmarks.planted_change --source pendulum_c --effect link_length --target upper --size 0.05
                                    [--shared ../shared] [--seed 0]

For changes that the suites of `benchmarks.recorded_changes` do not draw, because a plain test does not see them. The
runs are halved as there, by the seed, and the change is put into the later half by the same code. The recordings are no
part of this repository.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.recorded_changes import SOURCES
from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.library import NAMES
from residual_mpc.errors import BadInput


@click.command()
@click.option("--source", required=True, type=click.Choice([s.name for s in SOURCES]))
@click.option("--effect", required=True, type=click.Choice(NAMES))
@click.option("--target", default=None, help="Where it acts  [default: the only place]")
@click.option("--size", required=True, type=float, help="Difference or ratio, in SI units.")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--shared", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared"),
              show_default=True)  # fmt: skip
def planted_change(source: str, effect: str, target: str | None, size: float, seed: int, shared: Path) -> None:
    """Halve the runs, change the later half, compare the two."""
    from residual_mpc import compare, load_robot, read_runs
    from residual_mpc.api.runs import usable
    from residual_mpc.blind.recorded.case_files import write_case
    from residual_mpc.blind.recorded.make import two_halves

    folder = shared / "data" / next(s.folder for s in SOURCES if s.name == source)
    if not (folder / "robot.toml").is_file():
        click.echo(f"{source}: {folder} is absent", err=True)
        return
    robot = load_robot(folder / "robot.toml")
    rng = np.random.default_rng(seed)
    before, after = two_halves(robot.file, usable(read_runs(robot, str(folder))).runs, rng)
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as work:
        case = Path(work) / "case"
        write_case(case, robot.file, before, changed(after, effect, target, size, rng))
        copy = load_robot(case / "robot.toml")
        found = compare(copy, read_runs(copy, case / "before"), read_runs(copy, case / "after"), seed=0)
    for line in lines(found.document):
        click.echo(line)
    click.echo(f"{time.perf_counter() - begin:.0f} s")


def changed(half: Half, effect: str, target: str | None, size: float, rng: np.random.Generator) -> Half:
    """The half with the change. Raises BadInput where these runs cannot carry it there."""
    from residual_mpc.blind.recorded.kinds.library import carried_by

    places = [(kind, t) for kind, targets in carried_by(half, (effect,)) for t in targets]
    fitting = [(kind, t) for kind, t in places if target is None or t == target]
    if len(fitting) != 1:
        known = ", ".join(str(t) for _, t in places)
        raise BadInput(f"{effect} needs one target of {known}, got {target}", "--target", "name one of them")
    kind, place = fitting[0]
    (parameter,) = kind.size(half, place, 0.0, np.random.default_rng(0))
    return kind.apply(half, place, {parameter: size}, rng)


def lines(answer: dict[str, Any]) -> list[str]:
    """What a comparison says, a line each."""
    out = [f"verdict  {answer['verdict']}"]
    for change in answer["changes"]:
        place = f"{change['effect']} {change['target']}" if change["target"] else change["effect"]
        for name, number in change["parameters"].items():
            low, high = number["change"]["ci95"]
            out.append(
                f"{place}: {name} {number['change']['value']:.4g} "
                f"({low:.4g} to {high:.4g}) at {change['probability']:.2f}"
            )
    out += [f"group  {group}" for group in answer["confounded"]]
    gap = answer["gap"]
    out.append(f"gap  {gap['before']:.3g}, {gap['after']:.3g} after, {gap['after_explained']:.3g} with the changes")
    return [*out, *answer["notes"]]


if __name__ == "__main__":
    planted_change()
