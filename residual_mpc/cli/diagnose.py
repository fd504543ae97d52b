"""`residual-mpc diagnose`."""

import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from residual_mpc.cli.common import (
    emit,
    horizon_option,
    json_option,
    names,
    out_option,
    read,
    robot_option,
    runs_argument,
    seed_option,
    writable_folder,
)
from residual_mpc.cli.progress import progress_bar
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.api.diagnosis import Diagnosis


@click.command()
@robot_option
@runs_argument
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
    video: Path | None,
    horizon: float,
    as_json: bool,
    seed: int,
) -> None:
    """Find where the gap lies, which unmodelled effects cause it, and how far it shrinks once they are modelled.

    A diagnosis that was stopped, with Ctrl-C or otherwise, leaves the best effects so far in unfinished.json, and goes
    on when the same command is given again with the same --out.
    """
    writable_folder(out)
    if video is not None:
        from residual_mpc.report.motion.animation import check_video

        check_video(video)
        writable_folder(video.parent)
    nominal, logged = read(robot, runs)

    from residual_mpc.api.diagnosis import diagnose as run_diagnosis

    with progress_bar() as progress, _told_where(out):
        found = run_diagnosis(
            nominal, logged, only=names(only), without=names(without), held_out=held_out, horizon=horizon, seed=seed,
            start=start, out=out, command=shlex.join(["residual-mpc", *sys.argv[1:]]), progress=progress,
            say=progress.say,
        )  # fmt: skip
    document = found.document_in(out)
    filmed = video is not None and _save_video(found, video)
    if as_json:
        emit(document)
        return
    for line in found.lines():
        click.echo(line)
    following = document["next_experiment"]
    if following:
        click.echo(f"  next experiment: {following['what']}")
        planned = out / following["commands"] if following["commands"] else f"plan with: {following['excite']}"
        click.echo(f"  commands: {planned}")
    click.echo(f"  report: {out / 'report.html'}")
    if filmed:
        click.echo(f"  video: {video}")


@contextmanager
def _told_where(out: Path) -> Iterator[None]:
    """Where Ctrl-C stops the work, say what it has left there."""
    begun = time.time()
    try:
        yield
    except KeyboardInterrupt:
        from residual_mpc.api.diagnosis_files import ANSWER
        from residual_mpc.api.early_answers import SO_FAR

        files = [out / name for name in (SO_FAR, ANSWER)]
        written = [f for f in files if f.is_file() and f.stat().st_mtime >= begun - 1.0]
        if written:
            click.echo(f"the best answer so far is {written[0]}", err=True)
        click.echo("run the same command again to continue", err=True)
        raise


def _save_video(found: "Diagnosis", video: Path) -> bool:
    """Whether the video was written: the answer is there without it, so what is in the way is a warning."""
    try:
        found.save_video(video)
    except BadInput as error:
        click.echo(f"warning: no video: {error}", err=True)
        return False
    return True
