"""The methods that `residual-mpc blind score` is given, and the score of suites of recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from residual_mpc.cli.common import emit
from residual_mpc.errors import BadInput

if TYPE_CHECKING:
    from residual_mpc.blind.recorded.score.score import Swept


def score_recorded_runs(swept: Swept, out: Path | None, ledger: Path, as_json: bool) -> None:
    """`score` of a suite of recorded runs."""
    from residual_mpc.blind.recorded.score.page import lines, write_recorded_page
    from residual_mpc.blind.recorded.score.score import score_recorded
    from residual_mpc.blind.suite import write_json

    scores = score_recorded([swept], ledger)
    first = scores.summaries[0].document() | {"methods": [s.document() for s in scores.summaries[1:]]}
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "score.json", {"score": first})
        write_recorded_page(scores, out / "blind.html")
    if as_json:
        emit({"score": first})
        return
    for line in lines(scores):
        click.echo(line)


def methods_of(given: tuple[str, ...], unnamed: str = "diagnose") -> dict[str, Path]:
    """Name to folder of each method; a folder without a name is the method ``unnamed``."""
    methods: dict[str, Path] = {}
    for text in given:
        name, equals, folder = text.partition("=")
        name, folder = (name, folder) if equals else (unnamed, text)
        if not name or not folder or name in methods:
            raise BadInput(f"must be NAME=FOLDER with a different name for each method, got {text!r}", "--results")
        methods[name] = Path(folder)
    return methods
