"""How often the test of `compare` sees a change where there is none: random divisions of untouched recorded runs.

python -m benchmarks.change_alarms [--shared ../shared] [--source NAME ...] [--divisions 200] [--seed 0] [--draws 1]
                                   [--runs N]

The recorded runs of a robot are divided at random into two sets. Each draw computes the common model and the estimates
of each stretch once, from a first division, and then runs the test on many other divisions. The share of divisions with
p at or below a level should be at most that level. A source whose folder is absent says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from benchmarks.recorded_changes import SOURCES
from residual_mpc.api.robot import load_robot
from residual_mpc.api.run_models import RunModels
from residual_mpc.api.runs import read_runs, usable
from residual_mpc.comparison.account import account_of
from residual_mpc.comparison.conditions import driving_of
from residual_mpc.comparison.contrast import Estimates, estimates_of, tested
from residual_mpc.comparison.prepare import (
    ComparisonInput,
    cut_sets,
    problem_on,
    space_for,
    stretches_of,
    windows_for,
    with_driving,
)
from residual_mpc.comparison.search import probes_of
from residual_mpc.comparison.settings import ComparisonSettings
from residual_mpc.comparison.units import Units, averaged
from residual_mpc.diagnosis.fit.least_squares import fit_all
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.longer_steps import on_longer_steps
from residual_mpc.models.robot_file import noise_over

LEVELS = (0.02, 0.04, 0.1, 0.3)


@dataclass(frozen=True, eq=False)
class Untouched:
    """What the test is made from. units: with the labels of the first division, and the conditions that do not depend
    on them; driving (U, k): components of the commands, of which the test takes those that the division balances."""

    units: Units
    driving: np.ndarray
    estimates: Estimates


@click.command()
@click.option("--shared", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared"),
              show_default=True)  # fmt: skip
@click.option("--source", "names", multiple=True, type=click.Choice([s.name for s in SOURCES]), help="[default: all]")
@click.option("--divisions", type=int, default=200, show_default=True, help="Of each draw.")
@click.option("--draws", type=int, default=1, show_default=True, help="First divisions, with a common model each.")
@click.option("--runs", "most", type=int, help="Drawn at random from those of a source.  [default: all]")
@click.option("--seed", type=int, default=0, show_default=True)
def change_alarms(
    shared: Path, names: tuple[str, ...], divisions: int, draws: int, most: int | None, seed: int
) -> None:
    """Print the share of divisions whose smallest p is at or below each level."""
    click.echo("source        draw  runs  probes  " + "  ".join(f"p <= {level:<4g}" for level in LEVELS))
    for source in (s for s in SOURCES if not names or s.name in names):
        folder = shared / "data" / source.folder
        if not (folder / "robot.toml").is_file():
            click.echo(f"{source.name}: {folder} is absent", err=True)
            continue
        for draw in range(draws):
            rng = np.random.default_rng([seed, draw])
            untouched = divided(folder, rng, most)
            p = np.array([division(untouched, rng) for _ in range(divisions)])
            shares = "  ".join(f"{(p <= level).mean():>9.1%}" for level in LEVELS)
            runs, probes = len(np.unique(untouched.units.run)), len(untouched.estimates.probes)
            click.echo(f"{source.name:<12}  {draw:>4}  {runs:>4}  {probes:>6}  {shares}")


def divided(folder: Path, rng: np.random.Generator, most: int | None = None) -> Untouched:
    """Divide some of the runs, fit the common model to the first set, and compute the estimates of each stretch."""
    settings = ComparisonSettings()
    robot = load_robot(folder / "robot.toml")
    runs = usable(read_runs(robot, str(folder)))
    order = rng.permutation(len(runs.runs))[:most]
    before, after = (tuple(runs.runs[i] for i in part) for part in np.array_split(order, 2))
    names, models = [r.name for r in (*before, *after)], RunModels(robot)
    given = ComparisonInput(
        before, after, tuple(models.of(n) for n in names), noise_over(robot.file, names), robot.file.tunable,
        Options(),
    )  # fmt: skip
    sets = cut_sets(given, settings)
    account = account_of(
        given.before, given.robots[: len(before)], given.noise, given.tunable, given.options, settings.account, rng,
        lambda stage, done: None,
    )  # fmt: skip
    windows, scales = windows_for(given, sets, rng, settings)[0]
    exact = problem_on(windows, scales, space_for(given, sets), account, settings.search.final_steps, settings)
    problem = on_longer_steps(exact, scales, account, settings=settings.results.predict)
    fit = fit_all(problem, [account], settings=settings.results.fit)[0]
    units = stretches_of(problem.data, sets, given, settings)
    driving = averaged(driving_of(problem.data), units.number, units.count)
    return Untouched(units, driving, estimates_of(problem, fit, units, probes_of(problem, fit)))


def division(of: Untouched, rng: np.random.Generator) -> float:
    """The smallest p after dividing the runs again into two sets of the same sizes."""
    settings = ComparisonSettings().contrast
    runs, first = np.unique(of.units.run, return_index=True)
    side = dict(zip(runs.tolist(), rng.permutation(of.units.later[first]).tolist(), strict=True))
    units = replace(of.units, later=np.array([side[r] for r in of.units.run.tolist()]))
    return tested(of.estimates, with_driving(units, of.driving, settings), settings).p


if __name__ == "__main__":
    change_alarms()
