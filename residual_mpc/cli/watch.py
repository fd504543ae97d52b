"""`residual-mpc watch`."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from residual_mpc.cli.common import horizon_option, json_option, robot_option, seed_option, writable_folder
from residual_mpc.cli.progress import StatusLine


@click.command()
@robot_option
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    help="Watch the model in this diagnosis.json or model.json  [default: the nominal model]",
)
@click.option(
    "--reference", multiple=True, metavar="RUN",
    help="Runs of steady running to measure changes against (file, folder or pattern); repeatable  [default: the runs "
    "of the model's diagnosis, else the beginning of the stream]",
)  # fmt: skip
@click.option(
    "--learn", type=click.FloatRange(3.0, 14.0), default=10.0, show_default=True, metavar="MIN",
    help="Minutes of the stream that serve as the reference where there is no other.",
)  # fmt: skip
@click.option(
    "--every", type=click.FloatRange(1.0, 3600.0), default=10.0, show_default=True, metavar="S",
    help="Print the gap every so many seconds of the stream.",
)  # fmt: skip
@click.option("--once", is_flag=True, help="End when everything that is there was read, instead of waiting for more.")
@click.option("--page", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE",
              help="Keep an HTML page of the gap up to date.")  # fmt: skip
@horizon_option
@json_option
@seed_option
def watch(
    robot: str, logs: tuple[str, ...], model: Path | None, reference: tuple[str, ...], learn: float, every: float,
    once: bool, page: Path | None, horizon: float, as_json: bool, seed: int,
) -> None:  # fmt: skip
    """Follow logs as they arrive, and say when the gap has changed for certain, what changed, and since when.

    LOG is a growing CSV file, a folder in which files appear or grow, or - for a table on standard input. Ctrl-C ends
    the watch with a summary. With --json each event is one line.
    """
    if page is not None:
        writable_folder(page.absolute().parent)
    from residual_mpc.api.robot import load_robot
    from residual_mpc.api.runs import read_runs
    from residual_mpc.api.watch import watch as run_watch
    from residual_mpc.monitoring.events import document_of
    from residual_mpc.monitoring.settings import WatchSettings
    from residual_mpc.report.watch import LivePage, event_lines

    nominal = load_robot(robot)
    steady = read_runs(nominal, reference) if reference else None
    settings = WatchSettings(learn=60.0 * learn, every=every)
    live = None if page is None else LivePage(page, nominal.name)
    status = StatusLine()
    with _stop_signal(status.erase) as stopped:
        events = run_watch(
            nominal, logs, model=model, reference=steady, horizon=horizon, once=once, seed=seed, settings=settings,
            progress=status, stopped=stopped,
        )  # fmt: skip
        try:
            for event in events:
                status.erase()
                document = None if event is None else document_of(event)
                if live is not None:
                    live.take(document)
                if document is not None:
                    lines = [json.dumps(document, allow_nan=False)] if as_json else event_lines(document)
                    click.echo("\n".join(lines))
        finally:
            status.erase()


@contextmanager
def _stop_signal(before_words: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed or SIGTERM came: the watch then ends with its summary. A second Ctrl-C stops at
    once. before_words: called before the first is acknowledged."""
    stop = False

    def told(number: int, frame: object) -> None:
        nonlocal stop
        if stop:
            raise KeyboardInterrupt
        stop = True
        before_words()
        click.echo("ending the watch; Ctrl-C again stops at once", err=True)

    before = {number: signal.signal(number, told) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
