"""`residual-mpc diagnose`."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import (
    Loaded,
    emit,
    horizon_option,
    json_option,
    load,
    name_robot_file,
    out_option,
    robot_option,
    runs_argument,
    seed_option,
    writable_folder,
)
from residual_mpc.cli.diagnosis_files import ANSWER, COMMANDS, REPORT, write_answer, write_whole
from residual_mpc.cli.progress import progress_bar
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.diagnosis.records import Diagnosis
    from residual_mpc.experiment.propose import Proposal


@click.command()
@robot_option
@runs_argument
@out_option("diagnosis.json, report.html, model.json")
@click.option(
    "--only", multiple=True, metavar="EFFECT", help="Consider only these effects; comma-separated or repeated."
)
@click.option(
    "--without", multiple=True, metavar="EFFECT", help="Leave these effects out; comma-separated or repeated."
)
@click.option(
    "--held-out",
    multiple=True,
    metavar="RUN",
    help="Runs to hold out of every fit (file or run name); may be repeated.",
)
@horizon_option
@json_option
@seed_option
def diagnose(
    robot: str,
    runs: tuple[str, ...],
    out: Path,
    only: tuple[str, ...],
    without: tuple[str, ...],
    held_out: tuple[str, ...],
    horizon: float,
    as_json: bool,
    seed: int,
) -> None:
    """Find where the gap lies, which unmodelled effects cause it, and by how much it shrinks once they are modelled."""
    writable_folder(out)
    chosen = _effects(only, "--only"), _effects(without, "--without")
    loaded = load(robot, runs)

    import numpy as np

    from residual_mpc.diagnosis.diagnose import diagnose as run_diagnosis
    from residual_mpc.diagnosis.driven import not_commanded
    from residual_mpc.diagnosis.options import Options
    from residual_mpc.models.robot_file import measured_over
    from residual_mpc.report import compose
    from residual_mpc.report.collect import collect
    from residual_mpc.residual.remainder import LEARNERS

    kept = None if not held_out else _kept(held_out, [r.name for r in loaded.runs])
    because = not_commanded(loaded.robots[0], measured_over(loaded.robot_file, [r.name for r in loaded.runs]))
    options = Options(horizon=horizon, only=chosen[0], without=chosen[1], without_because=because, held_out=kept)
    with progress_bar() as progress:

        def found(diagnosis: "Diagnosis") -> None:
            """The set and its numbers stand; what is left is still to be described, which may lower probabilities."""
            write_answer(_document(diagnosis, loaded, out), out)

        made = run_diagnosis(
            loaded.runs,
            loaded.robots,
            loaded.noise,
            loaded.robot_file.tunable,
            options,
            np.random.default_rng(seed),
            progress,
            LEARNERS,
            found,
        )
        progress("planning the next experiment", 0.96)
        document = _document(made.diagnosis, loaded, out)
        proposal = _proposal(document, loaded, robot, out, seed)
        document["next_experiment"] = proposal.next_experiment
        progress("drawing the report", 0.98)
        write_whole(document, compose(document, collect(made)), proposal.table, out)
    if as_json:
        emit(document)
    else:
        _print(document, out)


def _document(diagnosis: "Diagnosis", loaded: Loaded, out: Path) -> dict[str, Any]:
    """diagnosis.json, but for the next experiment made concrete."""
    from dataclasses import asdict

    from residual_mpc.diagnosis.document import to_document
    from residual_mpc.report import sentence
    from residual_mpc.report.words.rest import rest_sentence

    document = to_document(diagnosis)
    document["audit"] = [asdict(finding) for finding in loaded.findings]
    name_robot_file(document["model"], loaded.robot_file, out)
    document["command"] = shlex.join(["residual-mpc", *sys.argv[1:]])
    document["verdict_sentence"] = sentence(document)
    if document["remainder"]:
        document["remainder"]["sentence"] = rest_sentence(document["remainder"])
    return document


def _proposal(document: dict[str, Any], loaded: Loaded, robot: str, out: Path, seed: int) -> "Proposal":
    from residual_mpc.experiment.propose import propose
    from residual_mpc.models.load import load_robot

    call = ["residual-mpc", "excite", str(out / ANSWER), "--robot", robot, "--out", str(out / COMMANDS)]
    logged = {c for r in loaded.runs for c in (*r.columns, *r.extra_columns)}
    return propose(document, load_robot(loaded.robot_file), shlex.join(call), seed, logged)


def _effects(given: tuple[str, ...], option: str) -> tuple[str, ...]:
    from residual_mpc.effects.library import BY_NAME
    from residual_mpc.logs.columns import did_you_mean

    names = tuple(n.strip() for g in given for n in g.split(",") if n.strip())
    for name in names:
        if name not in BY_NAME:
            raise BadInput(f"there is no effect {name!r}", option, did_you_mean(name, BY_NAME))
    return names


def _kept(given: tuple[str, ...], names: list[str]) -> Any:
    from fnmatch import fnmatchcase

    from residual_mpc.diagnosis.hold_out import KeptBack

    out = []
    for text in given:
        found = [
            n
            for n in names
            if n == text or n == Path(text).stem or fnmatchcase(n, text) or fnmatchcase(n, Path(text).stem)
        ]
        if not found:
            raise BadInput(f"there is no run {text!r}", "--held-out", f"the runs are {', '.join(names[:12])}")
        out += [KeptBack(n) for n in found]
    return tuple(dict.fromkeys(out))


def _print(document: dict[str, Any], out: Path) -> None:
    from residual_mpc.report import diagnosis_lines

    for line in diagnosis_lines(document):
        click.echo(line)
    following = document["next_experiment"]
    if following:
        click.echo(f"  next experiment: {following['what']}")
        planned = out / following["commands"] if following["commands"] else f"plan them with: {following['excite']}"
        click.echo(f"  its commands: {planned}")
    click.echo(f"  report: {out / REPORT}")
