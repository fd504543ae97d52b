"""`python -m benchmarks.notebook_pages [NAME...]`: runs the notebooks, and writes each as a page of the documentation.

The pages in docs/notebooks hold output and plots, and are part of the repository, so that the site builds quickly and
without a kernel. A test compares their code with that of the notebooks.
"""

import base64
import io
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SOURCE, PAGES = ROOT / "notebooks", ROOT / "docs" / "notebooks"
TIMEOUT = 900  # s a cell
WIDTH = 900  # px, at most
QUALITY = 82  # of a WebP
LINES, LETTERS = 40, 200  # of a cell's output that are shown: lines, and letters of each
ANSI = re.compile(r"\x1b\[[0-9;]*m")


def page_of(notebook: Any, name: str, images: Path | None) -> str:
    """The notebook as Markdown. images: folder for its plots; None to leave out every output."""
    parts = (part for k, cell in enumerate(notebook.cells) for part in _cell(cell, f"{name}-{k}", images))
    return "\n\n".join(parts) + "\n"


def _cell(cell: Any, name: str, images: Path | None) -> Iterator[str]:
    if cell.cell_type == "markdown":
        yield re.sub(r"\((\d_\w+)\.ipynb\)", r"(\1.md)", cell.source)
        return
    yield f"```{'sh' if cell.source.startswith(('%%', '!')) else 'python'}\n{cell.source}\n```"
    if images is None:
        return
    text = "".join(_text(o) for o in cell.get("outputs", []))
    lines = [line.rstrip().split("\r")[-1] for line in ANSI.sub("", text).splitlines()]
    if lines:
        short = [line if len(line) <= LETTERS else f"{line[:LETTERS]} ..." for line in lines]
        shown = short[:LINES] + [f"... {len(lines) - LINES} more lines"] * (len(lines) > LINES)
        yield "```text\n" + "\n".join(shown).strip("\n") + "\n```"
    for data in (o.data for o in cell.get("outputs", []) if "text/html" in o.get("data", {})):
        html = re.sub(r'<style.*?</style>| border="\d"| class="dataframe"', "", data["text/html"], flags=re.S)
        yield re.sub(r"\n\s*\n", "\n", html).strip()
    pictures = [o.data["image/png"] for o in cell.get("outputs", []) if "image/png" in o.get("data", {})]
    for k, data in enumerate(pictures):
        file = f"{name}-{k}.webp"
        _save(data, images / file)
        yield f"![Plot of the cell above]({file})"


def _text(output: Any) -> str:
    """What an output prints, without warnings and progress."""
    if output.output_type == "stream":
        return str(output.text) if output.name == "stdout" else ""
    data = output.get("data", {})
    shown_otherwise = "image/png" in data or "text/html" in data
    return "" if shown_otherwise or "text/plain" not in data else f"{data['text/plain']}\n"


def _save(data: str, path: Path) -> None:
    from PIL import Image

    picture = Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")
    picture.thumbnail((WIDTH, 10 * WIDTH))
    picture.save(path, format="WEBP", quality=QUALITY, method=6)


def main(names: list[str]) -> None:
    import nbclient
    import nbformat

    PAGES.mkdir(exist_ok=True)
    for path in sorted(SOURCE.glob("*.ipynb")):
        if names and path.stem not in names:
            continue
        print(path.stem, flush=True)
        notebook = nbformat.read(path, as_version=4)
        place = {"metadata": {"path": str(SOURCE)}}
        nbclient.NotebookClient(notebook, timeout=TIMEOUT, kernel_name="python3", resources=place).execute()
        for old in PAGES.glob(f"{path.stem}-*.webp"):
            old.unlink()
        (PAGES / f"{path.stem}.md").write_text(page_of(notebook, path.stem, PAGES), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
