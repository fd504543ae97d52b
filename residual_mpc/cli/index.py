"""`residual-mpc index`."""

from pathlib import Path

import click

from residual_mpc.cli.common import emit, json_option, seed_option
from residual_mpc.errors import BadInput

NAME = "index.html"


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@json_option
@seed_option
def index(folder: Path, as_json: bool, seed: int) -> None:
    """Write FOLDER/index.html: what diagnose, compare, learn and run wrote in FOLDER and the folders below it.

    For each result the page has its verdict in a sentence, the gap before and after, and links to its files.
    """
    if not folder.is_dir():
        raise BadInput("must be a folder with results", str(folder), "give the folder above those named with --out")
    from residual_mpc.files import write_atomically
    from residual_mpc.report.index import entries_in, index_page

    entries = entries_in(folder)
    write_atomically(folder / NAME, index_page(folder.resolve().name, entries))
    if as_json:
        emit({"index": {"file": str(folder / NAME), "results": [e.document() for e in entries]}})
        return
    for e in entries:
        click.echo(f"{e.folder}: {e.title}. {e.sentence}".replace("\N{NO-BREAK SPACE}", " "))
    click.echo(f"  index: {folder / NAME}")
