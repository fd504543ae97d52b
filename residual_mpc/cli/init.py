"""`residual-mpc init`: a robot file from a model and a log, with every guess said."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import emit, json_option, seed_option
from residual_mpc.errors import BadInput
from residual_mpc.files import write_atomically

if TYPE_CHECKING:
    from residual_mpc.init.draft import Draft
    from residual_mpc.init.trial import Trial

ROBOT = "robot.toml"


@click.command()
@click.argument("model")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option("--out", type=click.Path(path_type=Path), default=Path(ROBOT), show_default=True, help="Robot file.")
@click.option("--force", is_flag=True, help="Overwrite an existing robot file.")
@click.option(
    "--mended",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Also write the runs with corrected units, signs and zeros, which a robot file cannot express.",
)
@json_option
@seed_option
def init(
    model: str, runs: tuple[str, ...], out: Path, force: bool, mended: Path | None, as_json: bool, seed: int
) -> None:
    """Draft a robot file from a model and a log, matching columns to joints, and list every guess.

    MODEL is an MJCF or URDF file, or the name of a built-in robot such as diff_drive. RUN... are tables, bags and other
    recordings, folders or glob patterns; their columns and topics may have any name.
    """
    from residual_mpc.init.built_in import draft_built_in
    from residual_mpc.init.draft import draft
    from residual_mpc.init.draft_text import robot_file_text
    from residual_mpc.init.mended_logs import refuse_corrected, write_corrected_logs
    from residual_mpc.init.trial import try_robot

    if out.is_dir():
        out = out / ROBOT
    if out.exists() and not force:
        remedy = "overwrite it with --force, or choose another with --out"
        raise BadInput("this file already exists", str(out), remedy)
    refuse_corrected(runs)
    by_name = model.isidentifier() and not Path(model).exists()
    drafted = draft_built_in(model, runs) if by_name else draft(Path(model), runs)
    text = robot_file_text(drafted, out.parent)
    trial = try_robot(text, out.parent, runs, drafted.mends)
    tables = list(runs)
    if mended is not None and drafted.mends:
        write_corrected_logs(runs, drafted.mends, mended)
        tables = [str(mended)]
    write_atomically(out, text)
    ready = not trial.errors and (not drafted.mends or mended is not None)
    again = ["init", model, *runs, "--out", str(out), "--force", "--mended", "mended"]
    to_mend = bool(drafted.mends) and mended is None and not trial.errors
    following = _command(again) if to_mend else _command(["gap" if ready else "check", "--robot", str(out), *tables])
    _say(drafted)
    if as_json:
        emit({"init": _document(drafted, trial, out, following, ready)})
    else:
        _report(drafted, trial, out, following, mended)


def _say(drafted: "Draft") -> None:
    """One line on stderr for everything noted, guessed, to be mended, and left."""
    for note in drafted.notes:
        click.echo(f"note: {note}", err=True)
    for guess in drafted.guesses:
        click.echo(f"guess: {guess}", err=True)
    for item in drafted.missing:
        click.echo(f"no column found: {item.name}: {item.why}", err=True)
    for item in drafted.unmatched:
        click.echo(f"unused: {item.name}: {item.why}", err=True)
    for mend in drafted.mends:
        click.echo(f"to correct in the log: {mend}", err=True)


LIKELY = 0.5  # confidence below which a guess is counted as weak


def _command(words: list[str]) -> str:
    import shlex

    return shlex.join(["residual-mpc", *words])


def _report(drafted: "Draft", trial: "Trial", out: Path, following: str, mended: Path | None) -> None:
    for finding in trial.findings:
        remedy = f" -> {finding.remedy}" if finding.remedy else ""
        click.echo(f"{finding.severity}: {finding.where + ': ' if finding.where else ''}{finding.message}{remedy}")
    rivals = sum(bool(g.rivals) for g in drafted.guesses)
    weak = sum(g.sure < LIKELY for g in drafted.guesses)
    count = f"{len(drafted.guesses)} guesses, {_of(rivals)}" + (f", {weak} below {LIKELY:.0%}" if weak else "")
    click.echo(f"{out}: {count}")
    if mended is not None:
        click.echo(f"{mended}: the corrected runs" if drafted.mends else "nothing to correct: --mended wrote no files")
    if trial.errors:
        click.echo(f"the runs cannot be used yet: fix {_errors(len(trial.errors))} listed above")
    elif drafted.mends and mended is None:
        many = len(drafted.mends)
        click.echo(f"usable once {many} {'column of the log is' if many == 1 else 'columns of the log are'} corrected")
    else:
        click.echo("usable")
    click.echo(f"next: {following}")


def _of(rivals: int) -> str:
    return "none ambiguous" if not rivals else f"{rivals} of them with an alternative about as plausible"


def _document(drafted: "Draft", trial: "Trial", out: Path, following: str, ready: bool) -> dict[str, Any]:
    from dataclasses import asdict

    guesses = [
        {"what": g.what, "value": g.value, "why": g.why, "sure": g.sure, "rivals": list(g.rivals)}
        for g in drafted.guesses
    ]
    mends = [
        {"column": m.column, "factor": m.factor, "offset": m.offset, "why": m.why, "sure": m.sure}
        for m in drafted.mends
    ]
    return {
        "robot": str(out),
        "notes": list(drafted.notes),
        "guesses": guesses,
        "unmatched": [asdict(u) for u in drafted.unmatched],
        "missing": [asdict(u) for u in drafted.missing],
        "mends": mends,
        "findings": [asdict(f) for f in trial.findings],
        "usable": ready,
        "next": following,
    }


def _errors(count: int) -> str:
    return "the error" if count == 1 else f"the {count} errors"
