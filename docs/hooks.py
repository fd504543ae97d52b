"""What mkdocs does besides: takes the gallery's whole reports into the site, where `benchmarks.gallery` has made them.

A page links one by `{report: NAME}`. Without the file the words stay out, so that the site builds without them.
"""

import re
import shutil
from pathlib import Path
from typing import Any

MADE = Path(__file__).resolve().parents[1] / "build" / "gallery"
LINK = re.compile(r"\{report: (\w+)\}")


def on_page_markdown(markdown: str, **kwargs: Any) -> str:
    """Each `{report: NAME}` as a link that opens the whole report, or nothing."""

    def link(found: re.Match[str]) -> str:
        name = f"{found[1]}.html"
        return f'<a href="gallery/{name}">Open the whole report</a>' if (MADE / name).is_file() else ""

    return LINK.sub(link, markdown)


def on_post_build(config: Any, **kwargs: Any) -> None:
    """The reports beside the pages that link them."""
    target = Path(config["site_dir"]) / "gallery"
    for page in sorted(MADE.glob("*.html")):
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(page, target)
