"""`residual-mpc diagnose`."""

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import click

from residual_mpc.cli.common import (
    emit,
    horizon_option,
    json_option,
    load,
    name_robot_file,
    out_option,
    progress_bar,
    robot_option,
    runs_argument,
    seed_option,
    writable_folder,
    write_atomically,
)
from residual_mpc.errors import BadInput


@click.command()
@robot_option
@runs_argument
@out_option("diagnosis.json, report.html, model.json")
@click.option(
    "--only", multiple=True, metavar="EFFECT", help="Look at these effects alone; may be repeated or a comma list."
)
@click.option(
    "--without", multiple=True, metavar="EFFECT", help="Leave these effects out; may be repeated or a comma list."
)
@click.option(
    "--held-out",
    multiple=True,
    metavar="RUN",
    help="Runs kept back from every fit (file or run name); may be repeated.",
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
    """Say where the gap lies, which unmodelled effects cause it, and how far it shrinks once they are added."""
    writable_folder(out)
    chosen = _effects(only, "--only"), _effects(without, "--without")
    loaded = load(robot, runs)

    import numpy as np

    from residual_mpc.diagnosis.diagnose import diagnose as run_diagnosis
    from residual_mpc.diagnosis.document import to_document
    from residual_mpc.diagnosis.driven import not_commanded
    from residual_mpc.diagnosis.options import Options
    from residual_mpc.experiment.propose import FILE, propose
    from residual_mpc.models.load import load_robot
    from residual_mpc.models.robot_file import measured_over
    from residual_mpc.report import sentence, write_report
    from residual_mpc.report.collect import collect
    from residual_mpc.report.words.rest import rest_sentence
    from residual_mpc.residual.remainder import LEARNERS

    kept = None if not held_out else _kept(held_out, [r.name for r in loaded.runs])
    because = not_commanded(loaded.robots[0], measured_over(loaded.robot_file, [r.name for r in loaded.runs]))
    options = Options(horizon=horizon, only=chosen[0], without=chosen[1], without_because=because, held_out=kept)
    with progress_bar() as progress:
        made = run_diagnosis(
            loaded.runs,
            loaded.robots,
            loaded.noise,
            loaded.robot_file.tunable,
            options,
            np.random.default_rng(seed),
            progress,
            LEARNERS,
        )
        document = to_document(made.diagnosis)
        document["audit"] = [_finding(f) for f in loaded.findings]
        name_robot_file(document["model"], loaded.robot_file, out)
        document["command"] = shlex.join(["residual-mpc", *sys.argv[1:]])
        document["verdict_sentence"] = sentence(document)
        if document["remainder"]:
            document["remainder"]["sentence"] = rest_sentence(document["remainder"])
        progress("planning the next experiment", 0.96)
        call = ["residual-mpc", "excite", str(out / "diagnosis.json"), "--robot", robot, "--out", str(out / FILE)]
        logged = {c for r in loaded.runs for c in (*r.columns, *r.extra_columns)}
        proposal = propose(document, load_robot(loaded.robot_file), shlex.join(call), seed, logged)
        document["next_experiment"] = proposal.next_experiment
        progress("writing the report", 0.97)
        write_report(document, collect(made), out)
    write_atomically(out / "model.json", json.dumps(document["model"], indent=2, allow_nan=False) + "\n")
    if proposal.table is None:
        (out / FILE).unlink(missing_ok=True)  # what an earlier diagnosis in this folder proposed
    else:
        write_atomically(out / FILE, proposal.table)
    write_atomically(out / "diagnosis.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    if as_json:
        emit(document)
    else:
        _summary(document, out)


def _effects(given: tuple[str, ...], option: str) -> tuple[str, ...]:
    from residual_mpc.effects.library import BY_NAME
    from residual_mpc.logs.columns import did_you_mean

    names = tuple(n.strip() for g in given for n in g.split(",") if n.strip())
    for name in names:
        if name not in BY_NAME:
            raise BadInput(f"no effect is called {name!r}", option, did_you_mean(name, BY_NAME))
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
            raise BadInput(f"no run is called {text!r}", "--held-out", f"the runs are {', '.join(names[:12])}")
        out += [KeptBack(n) for n in found]
    return tuple(dict.fromkeys(out))


def _finding(finding: Any) -> dict[str, Any]:
    from dataclasses import asdict

    return asdict(finding)


def _summary(document: dict[str, Any], out: Path) -> None:
    click.echo(document["verdict_sentence"])
    gap, shrink = document["gap"], document["shrink"]
    click.echo(
        f"  gap {gap['before']:.3g} -> {gap['after']:.3g} (noise floor {gap['noise_floor']:.2g}), "
        "on windows that no fit has seen"
    )
    if shrink:
        low, high = shrink["expected_ci95"]
        click.echo(
            f"  shrink expected {shrink['expected']:.0%} ({low:.0%} to {high:.0%}), achieved {shrink['value']:.0%}"
        )
    for cause in document["explanation"]:
        numbers = ", ".join(
            f"{n} = {p['value']:.4g} {p['unit']} ({p['ci95'][0]:.4g} to {p['ci95'][1]:.4g})"
            for n, p in cause["parameters"].items()
        )
        click.echo(f"  {_named(cause)}: {numbers}; probability {cause['probability']:.2f}")
    for group in document["confounded"]:
        names = [" + ".join(_named(t) for t in (m if isinstance(m, list) else [m])) for m in group]
        click.echo(f"  cannot be told apart on these runs: {', '.join(dict.fromkeys(names))}")
    if document["remainder"]:
        click.echo(f"  {document['remainder']['sentence']}")
    following = document["next_experiment"]
    if following:
        click.echo(f"  next: {following['what']}")
        where = f"{out / following['commands']}" if following["commands"] else f"planned by: {following['excite']}"
        click.echo(f"  its commands: {where}")
    click.echo(f"  report: {out / 'report.html'}")


def _named(term: dict[str, Any]) -> str:
    return f"{term['effect']} [{term['target']}]" if term["target"] else str(term["effect"])
