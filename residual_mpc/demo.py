"""`python -m residual_mpc.demo`: a robot that differs from its model, drawn at random, diagnosed, and driven better.

What is wrong with the robot is sealed before the diagnosis starts, and opened when the diagnosis is on disk. Then the
nominal and the corrected controller drive the same path on the true robot. With --family a robot of the benchmark is
drawn in its place, and not driven.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Protocol

import click

if TYPE_CHECKING:
    from residual_mpc.blind.records import Answer, Planted
    from residual_mpc.blind.score.claim import Claim
    from residual_mpc.closed_loop.protocols import Simulator
    from residual_mpc.models.robot_file import RobotFile

ROBOT = "scenarios.demo_robot:turtlebot"  # the factory of the robot, which this package finds by name alone
STARTS = 2  # seeds of sensor noise per controller
CONTROL_PERIOD = 0.05  # s
TRIES = 20  # seeds looked at until one can be drawn: some sets of effects fit no robot of a family


@dataclass(frozen=True)
class Case:
    """A drawn robot.

    `folder` holds what its user would have; `sealed` is the file of the answer that `commitment` (hex) fixes;
    `without` names effects that a diagnosis of it has to do without (the level `withheld`).
    """

    seed: int
    folder: Path
    sealed: Path
    commitment: str
    without: tuple[str, ...]


class DemoRobot(Protocol):
    """A robot that is simulated in place of a real one."""

    @property
    def describe(self) -> str:
        """In words, for the first line."""
        ...

    def answer(self) -> Answer:
        """What its model does not know."""
        ...

    def write(self, folder: Path) -> None:
        """What its user has: a robot file and logged runs."""
        ...

    def write_reference(self, file: Path) -> None:
        """A path to follow."""
        ...

    def plant(self, robot: RobotFile, period: float) -> Simulator:
        """The robot, to be driven in closed loop."""
        ...


@click.command()
@click.option("--family", default=None, help="Draw from this family of the blind benchmark: wheeled, arm, ...")
@click.option("--level", default="double", show_default=True, help="With --family, what is hidden: single, hard, ...")
@click.option("--seed", type=int, default=None, help="Of the robot and what it hides  [default: random]")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="[default: demo-SEED]")
@click.option("--show/--no-show", default=True, help="Open the page of results in a browser, if there is a screen.")
def demo(family: str | None, level: str, seed: int | None, out: Path | None, show: bool) -> None:
    """Draw a robot that differs from its model, diagnose it, open what was hidden, and drive with what was found."""
    import numpy as np

    begun = monotonic()
    robot = None
    if family is None:
        number = int(np.random.default_rng().integers(10_000)) if seed is None else seed
        robot, case = draw_demo_robot(number, out)
        click.echo(f"This is {robot.describe}.")
        click.echo("It differs from its model in ways that are sealed until the diagnosis is done.\n")
    else:
        case = draw(family, level, seed, out)
        click.echo(f"A robot and its model, drawn with --family {family} --level {level} --seed {case.seed}")
    place = case.sealed.parent.parent
    click.echo(f"  its user has:  {case.folder} (model parameters and logged runs)")
    click.echo(f"  hidden:        {case.sealed}")
    click.echo(f"  SHA-256:       {case.commitment}\n")
    found = diagnose(case, place)
    answer = open_seal(case)
    click.echo("\nThe seal is opened: the answer matches its commitment, and the runs are unchanged.")
    for line in comparison(answer, found):
        click.echo(f"  {line}")
    if robot is not None:
        click.echo("\nOn the true robot, one MPC follows a figure-eight with the nominal and with the corrected model:")
        for line in drive(robot, case, found.with_name("model.json"), place / "drive"):
            click.echo(f"  {line}")
    click.echo("\nTo look at:")
    shown = {"all of it": write_index(place), "report": found.with_name("report.html"),
             "motion": found.with_name("motion.webp"), "drive": place / "drive" / "drive.html"}  # fmt: skip
    for name, path in shown.items():
        if path.is_file():
            click.echo(f"  {name + ':':<10} {path}")
    click.echo(f"That took {monotonic() - begun:.0f} s.")
    if show:
        open_page(shown["all of it"])


def write_index(place: Path) -> Path:
    """One page with the diagnosis and the drive: what was found, how the robot moves, and where the reports are."""
    from residual_mpc.files import write_atomically
    from residual_mpc.report.index import entries_in, index_page

    page = place / "index.html"
    write_atomically(page, index_page(place.name, entries_in(place)))
    return page


def open_page(page: Path) -> None:
    """In a browser, where somebody sits before a screen."""
    import webbrowser

    screen = sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if screen and sys.stdout.isatty():
        webbrowser.open(page.resolve().as_uri())


def draw_demo_robot(seed: int, out: Path | None) -> tuple[DemoRobot, Case]:
    """The robot of the demo, with its answer sealed beside its runs."""
    import numpy as np

    from residual_mpc.blind.seal import seal, write_sealed
    from residual_mpc.errors import BadInput
    from residual_mpc.models.load import load_factory

    if seed < 0:
        raise BadInput(f"must be >= 0, got {seed}", "--seed")
    place = out or Path(f"demo-{seed}")
    folder, file = place / "robot", place / "answer" / "answer.json"
    robot: DemoRobot = load_factory(ROBOT, "the demo")(np.random.default_rng(seed))
    folder.mkdir(parents=True, exist_ok=True)
    robot.write(folder)
    sealed = seal(robot.answer(), folder)
    write_sealed(sealed, file)
    return robot, Case(seed, folder, file, sealed.commitment, ())


def drive(robot: DemoRobot, case: Case, model: Path, out: Path) -> list[str]:
    """Follow the robot's path with the nominal and the corrected controller, and say how far off each was."""
    from residual_mpc.api.model import augment
    from residual_mpc.api.robot import load_robot
    from residual_mpc.closed_loop.scenario import RunOptions, find_own_scenario

    nominal = load_robot(case.folder / "robot.toml")
    reference = out / "reference.csv"
    robot.write_reference(reference)
    options = RunOptions("mpc", seeds=STARTS, seed=case.seed, out=out)
    augmented = augment(nominal, model, dt=CONTROL_PERIOD)
    run = find_own_scenario()
    result = run(nominal, augmented, str(reference), robot.plant, None, options, lambda stage, done: None)
    of = {name: c["tracking_rmse"] for name, c in result["controllers"].items()}
    return tracking_lines(of["nominal"], of["augmented"])


def tracking_lines(nominal: float | None, corrected: float | None) -> list[str]:
    """Root mean square tracking errors, m, in words; None for a robot that ran away."""
    said = {"nominal": nominal, "corrected": corrected}
    words = {k: "lost its path" if e is None else f"{1e3 * e:.1f} mm off its reference" for k, e in said.items()}
    lines = [f"{k + ':':<11}{text}" for k, text in words.items()]
    if nominal is not None and corrected is not None and nominal > 0.0:
        change = 1.0 - corrected / nominal
        lines.append(f"The corrected model makes the error {abs(change):.0%} {'smaller' if change >= 0 else 'larger'}.")
    return lines


def draw(family: str, level: str, seed: int | None, out: Path | None) -> Case:
    """Draw a case and seal its answer beside it. Raises BadInput where the seed given cannot be drawn."""
    import numpy as np

    from residual_mpc.blind.make import MakeSettings, make_suite
    from residual_mpc.blind.suite import FIRST_TEST_SEED
    from residual_mpc.errors import BadInput

    if seed is not None and not 0 <= seed < FIRST_TEST_SEED:
        raise BadInput(f"must be from 0 to {FIRST_TEST_SEED - 1} (development seeds), got {seed}", "--seed")
    fresh = np.random.default_rng().integers(FIRST_TEST_SEED, size=TRIES)  # a demo that is different each time
    why = ""
    for number in [int(s) for s in fresh] if seed is None else [seed]:
        click.echo(f"drawing a robot (seed {number})", err=True)
        place = out or Path(f"demo-{number}")
        made = make_suite(MakeSettings((family,), (level,), 1, number, 1), place / "suite", place / "answer")
        if made.suite.cases:
            entry = made.suite.cases[0]
            sealed = place / "answer" / f"{entry.name}.json"
            return Case(number, made.suite.case(entry), sealed, entry.commitment, entry.without)
        why = made.failed[0][1]
    raise BadInput(f"no robot could be drawn: {why}", "--seed", "choose another seed, or omit it")


def diagnose(case: Case, place: Path) -> Path:
    """Run `residual-mpc diagnose` in a process that never meets the answer, and return its diagnosis.json."""
    runs = str(case.folder.relative_to(place))
    words = ["diagnose", "--robot", f"{runs}/robot.toml", runs, "--out", "diagnosis"]
    words += ["--video", "diagnosis/motion.webp"]
    words += [word for effect in case.without for word in ("--without", effect)]
    click.echo(f"$ cd {shlex.quote(str(place))}\n$ residual-mpc {shlex.join(words)}")
    sys.stdout.flush()  # the process writes to the same place
    program = [sys.executable, "-m", "residual_mpc.cli.main", *words]
    # one thread a library: on batches this small more of them cost time
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    status = subprocess.run(program, cwd=place, env=environment, check=False).returncode
    if status:
        sys.exit(status)
    return place / "diagnosis" / "diagnosis.json"


def open_seal(case: Case) -> Answer:
    """The hidden answer. Raises BadInput where it, or the runs, changed since it was sealed."""
    from residual_mpc.blind.seal import reveal

    return reveal(case.sealed, case.commitment, case.folder)


def comparison(answer: Answer, diagnosis: Path) -> list[str]:
    """Lines that say what was hidden and whether the diagnosis is right, by the rule of the benchmark."""
    from residual_mpc.blind.score.claim import read_claim
    from residual_mpc.blind.score.match import match

    claim = read_claim(diagnosis)
    result = match(answer, claim)
    lines = [f"hidden: {_planted(p, answer, claim)}" for p in answer.effects]
    lines += [f"hidden, not in the library: {cause}" for cause in answer.unknown]
    if answer.background:
        lines.append(f"faint in addition: {', '.join(p.effect for p in answer.background)}")
    if not answer.effects and not answer.unknown:
        lines.append("hidden: nothing")
    said = ", ".join(_named(*name) for name in claim.named)
    said = f"{claim.verdict} ({said})" if said and claim.verdict != "effects" else said or claim.verdict
    if not result.right:
        return [*lines, f"The diagnosis is wrong: it says {said}."]
    place = "" if result.target_right is None or result.target_right else ", but at another place"
    group = "" if result.group_size < 2 else ", up to what it says cannot be told apart on these runs"
    return [*lines, f"The diagnosis is right{place}{group}: {said}."]


def _planted(planted: Planted, answer: Answer, claim: Claim) -> str:
    """An effect with its parameters as planted, and as found where it was named at its place."""
    from residual_mpc.blind.score.match import counterpart

    name = counterpart(planted, answer, claim)
    parts = []
    for parameter, value in planted.parameters.items():
        estimate = None if name is None else claim.estimates[name].get(parameter)
        seen = "" if estimate is None else f" (found {estimate.value:.4g}, {estimate.low:.4g} to {estimate.high:.4g})"
        parts.append(f"{parameter} {value:.4g}{seen}")
    return f"{_named(planted.effect, planted.target)}: {', '.join(parts)}"


def _named(effect: str, target: str | None) -> str:
    return f"{effect} [{target}]" if target else effect


def main() -> None:
    """Exit status as `residual-mpc`'s."""
    from residual_mpc.errors import BadInput

    try:
        demo.main(standalone_mode=False)
    except OSError as error:
        click.echo(f"demo: {error.filename}: {error.strerror}. Choose another folder with --out.", err=True)
        sys.exit(2)
    except BadInput as error:
        click.echo(f"demo: {error}", err=True)
        sys.exit(2)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(1)


if __name__ == "__main__":
    main()
