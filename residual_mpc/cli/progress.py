"""Progress on stderr: a bar on a terminal, plain lines elsewhere, and in neither a long silence."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic

import click


@dataclass(frozen=True)
class Progress:
    """stage: shows what is done and the share that is behind; say: prints a line that stays."""

    stage: Callable[[str, float], None]
    say: Callable[[str], None]

    def __call__(self, stage: str, done: float) -> None:
        self.stage(stage, done)


QUIET = 20.0  # s without a new stage, after which a plain log says that work goes on


@contextmanager
def progress_bar(quiet: float = QUIET) -> Iterator[Progress]:
    """A bar with the stage and the time taken; plain lines where stderr is no terminal."""
    with _bar() if sys.stderr.isatty() else _lines(quiet) as report:
        yield report


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield Progress(
            lambda stage, done: bar.update(task, description=stage, completed=done),
            lambda line: bar.console.print(line, markup=False, highlight=False),
        )


@contextmanager
def _lines(quiet: float) -> Iterator[Progress]:
    """A line a stage; the stage again, with its seconds, every `quiet` seconds that it lasts."""
    stage, share, since = "", 0.0, monotonic()
    lock, over = threading.Lock(), threading.Event()

    def report(now: str, done: float) -> None:
        nonlocal stage, share, since
        with lock:
            if now != stage:
                click.echo(f"[{done:4.0%}] {now}", err=True)
                since = monotonic()
            stage, share = now, done

    def remind() -> None:
        told = since
        while not over.wait(quiet / 4.0):
            with lock:
                seconds = monotonic() - since
                if stage and monotonic() - max(told, since) >= quiet:
                    click.echo(f"[{share:4.0%}] {stage} ({seconds:.0f} s)", err=True)
                    told = monotonic()

    reminder = threading.Thread(target=remind, daemon=True)
    reminder.start()
    try:
        yield Progress(report, lambda line: click.echo(line, err=True))
    finally:
        over.set()
        reminder.join()
