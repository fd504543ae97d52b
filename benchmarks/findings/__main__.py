"""Diagnoses of the cases that outside checks of 0.1.0 found wrong, as a page of Markdown.

python -m benchmarks.findings --out build/findings [--case NAME ...] [--make-only] [--page FILE]

Cases that lie in ../shared/cases are read, the others are made from seeds. A case that the same program has diagnosed
with the same command is not diagnosed again, so that a call that was stopped goes on.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

import click

from benchmarks.findings import shared
from benchmarks.findings.catalogue import catalogue
from benchmarks.findings.page import mark_of, page
from benchmarks.findings.records import Case
from benchmarks.findings.run import Outcome, Places, Program, made, outcome, program_at

FOLDER = click.Path(path_type=Path, file_okay=False)
SHARED = Path(__file__).resolve().parents[2].parent / "shared"


@click.command()
@click.option("--out", type=FOLDER, default=Path("build/findings"), show_default=True)
@click.option("--case", "names", multiple=True, help="A case's name or a pattern such as 'perfect_*'.  [default: all]")
@click.option("--list", "listed", is_flag=True, help="Print the names of the cases and stop.")
@click.option("--make-only", is_flag=True, help="Make the cases and stop.")
@click.option("--again", is_flag=True, help="Make and diagnose anew what --out holds.")
@click.option("--page", "page_file", type=click.Path(path_type=Path, dir_okay=False), help="[default: stdout]")
@click.option("--program", type=click.Path(path_type=Path, dir_okay=False), help="[default: beside this Python]")
@click.option("--shared", "beside", type=FOLDER, default=SHARED, help="Holds `cases` and `data`.  [default: ../shared]")
def findings(
    out: Path, names: tuple[str, ...], listed: bool, make_only: bool, again: bool, page_file: Path | None,
    program: Path | None, beside: Path,
) -> None:  # fmt: skip
    """Make the cases, diagnose them, and write the page."""
    places = Places(out, beside / "cases", beside / "data")
    absent = absent_folders(places)
    for line in absent:
        click.echo(line, err=True)
    chosen = selected([*catalogue(), *shared.cases(places.shared_cases)], names)
    if listed:
        click.echo("\n".join(case.name for case in chosen))
    elif make_only:
        make(chosen, places, again)
    else:
        tool = program_at(program or Path(sys.executable).parent / "residual-mpc")
        text = page([diagnosed(case, places, tool, again) for case in chosen], tool.version, absent)
        if page_file is None:
            click.echo(text)
        else:
            page_file.write_text(text, encoding="utf-8")


def selected(cases: Sequence[Case], patterns: Sequence[str]) -> list[Case]:
    """The cases that a pattern names; a pattern that names none is an error."""
    for pattern in patterns:
        if not any(fnmatch(case.name, pattern) for case in cases):
            raise click.BadParameter(f"no case is called {pattern}; --list prints the names", param_hint="--case")
    return [case for case in cases if not patterns or any(fnmatch(case.name, p) for p in patterns)]


def absent_folders(places: Places) -> list[str]:
    """A sentence for each shared folder that is not there."""
    told = (
        (places.shared_cases, "the cases in it are left out"),
        (places.shared_data, "cases on recorded robots are not made"),
    )
    return [f"The folder shared/{path.name} is absent: {so}." for path, so in told if not path.is_dir()]


def make(cases: Sequence[Case], places: Places, again: bool) -> None:
    """Make the cases and say where they lie."""
    for case in cases:
        trouble = made(case, places, again)
        click.echo(f"{case.name}: {trouble or places.case(case)}")


def diagnosed(case: Case, places: Places, program: Program, again: bool) -> Outcome:
    """The case's outcome, with a line of progress."""
    result = outcome(case, places, program, again)
    click.echo(f"{case.name}: {result.trouble or mark_of(result)}, {result.seconds:.0f} s", err=True)
    return result


if __name__ == "__main__":
    findings()
