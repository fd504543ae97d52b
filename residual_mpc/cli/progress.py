"""Progress on stderr: a bar on a terminal, plain lines elsewhere, and in neither a long silence; for a program that
runs for days, one line that is rewritten on a terminal, and nothing elsewhere."""

import shutil
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
SOON = 4.0  # s after which the time left can be told
JUMP = 0.3  # share that is not reached that soon, unless an interrupted call is resumed: its pace is not known
LEAST = 0.3  # of the time that was left as a stage began: so much is left at least, however long the stage takes


class Pace:
    """How fast a piece of work goes. timed: whether its shares are shares of the time."""

    def __init__(self, timed: bool) -> None:
        self._start, self._began, self._share, self._told = monotonic(), 0.0, 0.0, timed

    def reach(self, share: float) -> float:
        """Take note of the share of the total time that has passed, and return the largest so far: work that restarts
        does not take back what is done."""
        if share > self._share:
            self._began, self._share = monotonic() - self._start, share
            self._told = self._told and not (self._began < SOON and share > JUMP)
        return self._share

    def words(self) -> str:
        """How long the rest takes, empty where that is not known."""
        left = time_left(monotonic() - self._start, self._began, self._share) if self._told else None
        return words_left(left)


def time_left(now: float, began: float, done: float) -> float | None:
    """s until the end, from the share `done` of the total time that had passed when the current stage began, `began` s
    after the start; now: s after the start. None where too little has passed to tell."""
    if began < SOON or not 0.0 < done < 1.0:
        return None
    left = began * (1.0 - done) / done
    return max(left - (now - began), LEAST * left)


def words_left(seconds: float | None) -> str:
    """Such as "about 40 s left"; empty where it is not known."""
    if seconds is None:
        return ""
    if seconds < 90.0:
        return f"about {max(5, 5 * round(seconds / 5.0))} s left"
    return f"about {round(seconds / 60.0)} min left" if seconds < 5400.0 else f"about {round(seconds / 3600.0)} h left"


@contextmanager
def progress_bar(quiet: float = QUIET, timed: bool = False) -> Iterator[Progress]:
    """A bar with the stage and the time taken, and the time left if the shares are shares of the time (timed); plain
    lines where stderr is no terminal."""
    pace = Pace(timed)
    with _bar(pace) if sys.stderr.isatty() else _lines(quiet, pace) as report:
        yield report


@contextmanager
def _bar(pace: Pace) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar
    from rich.text import Text

    class Left(ProgressColumn):
        """The time left, which goes down while a stage lasts."""

        def render(self, task: Task) -> Text:
            return Text(pace.words())

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), Left())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def report(stage: str, done: float) -> None:
            bar.update(task, description=stage, completed=pace.reach(done))

        yield Progress(report, lambda line: bar.console.print(line, markup=False, highlight=False))


@contextmanager
def _lines(quiet: float, pace: Pace) -> Iterator[Progress]:
    """A line a stage; the stage again, with its seconds, every `quiet` seconds that it lasts."""
    stage, share, since = "", 0.0, monotonic()
    lock, over = threading.Lock(), threading.Event()

    def report(now: str, done: float) -> None:
        nonlocal stage, share, since
        with lock:
            done = pace.reach(done)
            if now != stage:
                since = monotonic()
                click.echo(", ".join(x for x in (f"[{done:4.0%}] {now}", pace.words()) if x), err=True)
            stage, share = now, done

    def remind() -> None:
        told = since
        while not over.wait(quiet / 4.0):
            with lock:
                seconds = monotonic() - since
                if stage and monotonic() - max(told, since) >= quiet:
                    line = f"[{share:4.0%}] {stage} ({seconds:.0f} s)"
                    click.echo(", ".join(x for x in (line, pace.words()) if x), err=True)
                    told = monotonic()

    reminder = threading.Thread(target=remind, daemon=True)
    reminder.start()
    try:
        yield Progress(report, lambda line: click.echo(line, err=True))
    finally:
        over.set()
        reminder.join()


class StatusLine:
    """The stage and its share on one line of a terminal, which each stage rewrites. Nothing is written where stderr is
    no terminal. Call `erase` before printing anything else."""

    def __init__(self) -> None:
        self._shown = 0  # characters

    def __call__(self, stage: str, done: float) -> None:
        if not sys.stderr.isatty():
            return
        line = f"[{done:4.0%}] {stage}"[: shutil.get_terminal_size().columns - 1]
        click.echo(f"\r{line.ljust(self._shown)}", err=True, nl=False)
        self._shown = len(line)

    def erase(self) -> None:
        if self._shown:
            click.echo(f"\r{' ' * self._shown}\r", err=True, nl=False)
            self._shown = 0
