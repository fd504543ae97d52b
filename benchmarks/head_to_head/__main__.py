"""The head-to-head with `mujoco.sysid`, from the servo to the page.

python -m benchmarks.head_to_head [--seeds 5] [--first 0] [--keep build/head_to_head]
    [--page docs/results/head-to-head.md]

Needs the extra: pip install 'residual-mpc[sysid]'. Matches are kept, so that a second call carries on; remove the
folder to measure anew.
"""

from pathlib import Path

import click

from benchmarks.head_to_head.figure import draw
from benchmarks.head_to_head.match import play
from benchmarks.head_to_head.page import FIGURE, write_page
from benchmarks.head_to_head.servo import CASES
from benchmarks.recorded.measure import commit


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=5, show_default=True, help="Of each case.")
@click.option("--first", type=click.IntRange(min=0), default=0, show_default=True, help="The first seed.")
@click.option("--keep", type=click.Path(path_type=Path, file_okay=False), default=Path("build/head_to_head"),
              show_default=True, help="Folder for the cases, the reports of both tools and their answers.")  # fmt: skip
@click.option("--page", type=click.Path(path_type=Path, dir_okay=False), help="[default: stdout, without the figure]")
def head_to_head(seeds: int, first: int, keep: Path, page: Path | None) -> None:
    """Run both tools on the same files of a servo whose model lacks something, and write what they said."""
    code = commit()
    matches = [
        play(case, seed, keep, code, lambda text: click.echo(text, err=True))
        for seed in range(first, first + seeds)
        for case in CASES
    ]  # fmt: skip
    text = write_page(matches)
    if page is None:
        click.echo(text)
        return
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text(text, encoding="utf-8")
    draw(matches, page.parent / FIGURE)


if __name__ == "__main__":
    head_to_head()
