"""`residual-mpc diagnose`."""

import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from residual_mpc.cli.common import (
    emit,
    horizon_option,
    json_option,
    names,
    out_option,
    read,
    robot_option,
    seed_option,
    writable_folder,
)
from residual_mpc.cli.many import TakingMany
from residual_mpc.cli.options import with_options
from residual_mpc.cli.progress import progress_bar
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.api.confirmation import Confirmation, Progress
    from residual_mpc.api.diagnosis import Diagnosis
    from residual_mpc.api.robot import NominalRobot
    from residual_mpc.api.runs import Runs


@click.command(cls=TakingMany)
@robot_option
@click.argument("runs", nargs=-1, metavar="RUN...")
@out_option("diagnosis.json, report.html, model.json")
@click.option(
    "--only", multiple=True, metavar="EFFECT", help="Consider only these effects; comma-separated, repeatable."
)
@click.option("--without", multiple=True, metavar="EFFECT", help="Exclude these effects; comma-separated, repeatable.")
@click.option(
    "--held-out",
    multiple=True,
    metavar="RUN",
    help="Run to hold out of every fit (file or run name); repeatable.",
)
@click.option(
    "--from",
    "start",
    type=click.Path(path_type=Path),
    metavar="DIAGNOSIS",
    help="Begin the search with the effects of an earlier diagnosis.json of this robot; it may drop them.",
)
@click.option(
    "--confirm",
    "new",
    multiple=True,
    metavar="NEW...",
    help="New runs to test the diagnosis on; they are not used to make it. Without RUN..., the diagnosis given with "
    "--from is tested.",
)
@click.option(
    "--changed",
    multiple=True,
    metavar="CHANGE",
    help="Known change made to the robot before the --confirm runs: EFFECT[.PARAMETER][@TARGET] followed by =VALUE, "
    "+=VALUE, -=VALUE or =none, such as payload+=0.2; repeatable.",
)
@click.option(
    "--video",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the robot's motion, measured, predicted and corrected, to this file as well: .mp4, .webp or .gif.",
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
    start: Path | None,
    new: tuple[str, ...],
    changed: tuple[str, ...],
    video: Path | None,
    horizon: float,
    as_json: bool,
    seed: int,
) -> None:
    """Find where the gap lies, which unmodelled effects cause it, and how far it shrinks once they are modelled.

    A diagnosis that was stopped, with Ctrl-C or otherwise, leaves the best effects so far in unfinished.json, and goes
    on when the same command is given again with the same --out.

    With --confirm, also reports which of the named effects and alternative explanations the new runs support and which
    they exclude.
    """
    _check_options(runs, start, new, changed)
    if not runs:
        _check_absent("only", "without", "held_out", "horizon", "video")
    writable_folder(out)
    if video is not None:
        from residual_mpc.report.motion.animation import check_video

        check_video(video)
        writable_folder(video.parent)
    if not runs:
        assert start is not None
        nominal, later = read(robot, new)
        with progress_bar() as progress:
            confirmed = _confirmed(nominal, start, later, changed, seed, out, progress)
        _show(confirmed, out, as_json)
        return
    nominal, logged = read(robot, runs)
    unseen = read(robot, new)[1] if new else None
    if unseen is not None:
        from residual_mpc.api.confirmation import check_options

        check_options(nominal, logged, unseen, changed)

    from residual_mpc.api.diagnosis import diagnose as run_diagnosis

    tested: Confirmation | None = None
    with progress_bar(timed=True) as progress, _told_where(out):
        found = run_diagnosis(
            nominal, logged, only=names(only), without=names(without), held_out=held_out, horizon=horizon, seed=seed,
            start=start, out=out, command=shlex.join(["residual-mpc", *sys.argv[1:]]), progress=progress,
            say=progress.say,
        )  # fmt: skip
        if unseen is not None and found.explanation:
            from residual_mpc.api.diagnosis_files import ANSWER

            tested = _confirmed(nominal, out / ANSWER, unseen, changed, seed, out, progress, found)
    filmed = video is not None and _save_video(found, video)
    if tested is not None:
        _show(tested, out, as_json)
        return
    if unseen is not None:
        click.echo("warning: the diagnosis names no effect, so there is nothing to confirm", err=True)
    document = found.document_in(out)
    if as_json:
        emit(document)
        return
    for line in found.lines():
        click.echo(line)
    _next_experiment(document, out)
    click.echo(f"  report: {out / 'report.html'}")
    if filmed:
        click.echo(f"  video: {video}")


def _check_options(runs: tuple[str, ...], start: Path | None, new: tuple[str, ...], changed: tuple[str, ...]) -> None:
    """Raises UsageError where what was given does not go together."""
    if not runs and not (new and start):
        raise click.UsageError("Missing argument 'RUN...' (it may be omitted only with both --confirm and --from).")
    if changed and not new:
        raise click.UsageError("Option '--changed' requires --confirm with the runs recorded after the change.")


def _check_absent(*options: str) -> None:
    """Raises UsageError for an option that a test of an earlier diagnosis does not use."""
    from click.core import ParameterSource

    for option in options:
        if click.get_current_context().get_parameter_source(option) is not ParameterSource.DEFAULT:
            raise click.UsageError(f"Option '--{option.replace('_', '-')}' needs RUN... to diagnose.")


def _confirmed(
    nominal: "NominalRobot",
    diagnosis: Path,
    later: "Runs",
    changed: tuple[str, ...],
    seed: int,
    out: Path,
    progress: "Progress",
    made: "Diagnosis | None" = None,
) -> "Confirmation":
    from residual_mpc.api.confirmation import confirm

    return confirm(
        nominal, diagnosis, later, changed=changed, seed=seed, out=out,
        command=shlex.join(["residual-mpc", *sys.argv[1:]]), evidence=made.evidence if made else None,
        commands=made.commands if made else None, progress=progress,
    )  # fmt: skip


def _show(found: "Confirmation", out: Path, as_json: bool) -> None:
    if as_json:
        emit(found.document_in(out))
        return
    for line in found.lines():
        click.echo(line)
    _next_experiment(found.document_in(out), out)
    click.echo(f"  report: {out / 'report.html'}")


def _next_experiment(document: dict[str, Any], out: Path) -> None:
    """Say what to record next, if anything is left open."""
    following = document["next_experiment"]
    if following:
        click.echo(f"  next experiment: {following['what']}")
        planned = out / following["commands"] if following["commands"] else f"run {following['excite']} to plan them"
        click.echo(f"  commands: {planned}")


@contextmanager
def _told_where(out: Path) -> Iterator[None]:
    """Where Ctrl-C stops the work, say what it has left there."""
    begun = time.time()
    try:
        yield
    except KeyboardInterrupt:
        from residual_mpc.api.diagnosis_files import ANSWER
        from residual_mpc.api.early_answers import SO_FAR
        from residual_mpc.api.resume import FILE as RESUME

        files = [out / name for name in (SO_FAR, ANSWER)]
        written = [f for f in files if f.is_file() and f.stat().st_mtime >= begun - 1.0]
        if written:
            click.echo(f"the best answer so far is {written[0]}", err=True)
        if (out / RESUME).is_file():
            click.echo("run the same command again to continue", err=True)
        raise


def _save_video(found: "Diagnosis", video: Path) -> bool:
    """Whether the video was written: the answer is there without it, so what is in the way is a warning."""
    try:
        found.save_video(video)
    except BadInput as error:
        click.echo(f"warning: no video: {with_options(str(error))}", err=True)
        return False
    return True
