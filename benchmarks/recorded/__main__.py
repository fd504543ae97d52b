"""Diagnoses of recorded robots as a page of Markdown: gaps on held-out runs, causes, and the commands.

python -m benchmarks.recorded [--data ../shared/data] [--row NAME ...] [--keep build/recorded] [--again] [--page FILE]

The recordings are no part of this repository. A row whose folder is absent says so, and the others are
measured. Each row calls the command line as a user would, in a process of its own. A row that was measured with the
same command and the same code is read from --keep, so that a call that was stopped goes on.
"""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.recorded.measure import measure
from benchmarks.recorded.page import document
from benchmarks.recorded.picture import staged_picture
from benchmarks.recorded.rows import PICTURED, ROWS


@click.command()
@click.option("--data", type=click.Path(path_type=Path, file_okay=False), default=Path("../shared/data"),
              show_default=True)  # fmt: skip
@click.option("--row", "names", multiple=True, type=click.Choice([r.name for r in ROWS]), help="[default: all]")
@click.option("--keep", type=click.Path(path_type=Path, file_okay=False), default=Path("build/recorded"),
              show_default=True, help="Folder for the diagnoses and their reports.")  # fmt: skip
@click.option("--again", is_flag=True, help="Measure anew what --keep holds.")
@click.option("--page", type=click.Path(path_type=Path, dir_okay=False), help="[default: stdout]")
def recorded(data: Path, names: tuple[str, ...], keep: Path, again: bool, page: Path | None) -> None:
    """Diagnose the recorded robots and write the page."""
    if not data.is_dir():
        click.echo(f"{data} is absent: there are no recordings to measure on. Name their folder with --data.")
        return
    chosen = [row for row in ROWS if not names or row.name in names]
    rows = [measure(row, data, keep, again) for row in chosen]
    text = document(rows)
    if page is None:
        click.echo(text)
    else:
        page.write_text(text, encoding="utf-8")
        arm = next((m.document for m in rows if m.row.name == PICTURED and m.document is not None), None)
        if arm is not None:
            staged_picture(arm["stages_of_gap"], page.parent / "images" / f"{PICTURED}-staged.png")


if __name__ == "__main__":
    recorded()
