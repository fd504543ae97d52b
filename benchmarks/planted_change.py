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

import click
import numpy as np

from benchmarks.recorded_changes import SOURCES
from residual_mpc.blind.recorded.half import Half
from residual_mpc.blind.recorded.kinds.library import NAMES, carried_by
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
    click.echo(str(found))
    click.echo(f"{time.perf_counter() - begin:.0f} s")


def changed(half: Half, effect: str, target: str | None, size: float, rng: np.random.Generator) -> Half:
    """The half with the change. Raises BadInput where these runs cannot carry it there."""
    places = [(kind, t) for kind, targets in carried_by(half, (effect,)) for t in targets]
    fitting = [(kind, t) for kind, t in places if target is None or t == target]
    if len(fitting) != 1:
        known = ", ".join(str(t) for _, t in places)
        raise BadInput(f"{effect} needs one target of {known}, got {target}", "--target", "name one of them")
    kind, place = fitting[0]
    numbers = tuple(kind.size(half, place, 0.0, np.random.default_rng(0)))
    if len(numbers) != 1:
        raise BadInput(f"{effect} has more than one number: {', '.join(numbers)}", "--effect", "choose another")
    return kind.apply(half, place, {numbers[0]: size}, rng)


if __name__ == "__main__":
    planted_change()
