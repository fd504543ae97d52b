"""A matplotlib figure as a piece of the page: SVG in the page's colours, or a PNG where that gets too big."""

import base64
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LARGEST_SVG = 300_000  # bytes; a page of twelve such drawings still opens at once on a phone
PNG_DPI = 200

# Stand-ins that matplotlib can parse, and the custom properties of templates/style.css that take their place.
# They are the light theme's colours, so that the PNG, which follows no theme, looks right on its white card.
COLOURS = {
    "ink": "#1c2430",
    "muted": "#5b6675",
    "grid": "#d8dde4",
    "before": "#c2500a",
    "after": "#0b62b4",
    "floor": "#6d7885",
    "effects": "#00805f",  # these three: controllers of a closed-loop run
    "network": "#b14d8a",
    "online": "#1a86bd",
}

SETTINGS: Any = {
    "svg.fonttype": "none",  # text stays text: sharp, small, found by a search
    "text.parse_math": False,  # a column may be called "a$b$"
    "font.size": 9,
    "axes.edgecolor": COLOURS["muted"],
    "axes.labelcolor": COLOURS["muted"],
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.7,
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
    "text.color": COLOURS["ink"],
    "lines.linewidth": 1.4,
    "path.simplify": True,
    "path.simplify_threshold": 0.4,  # pixels of 1/72 inch: below what the page can show
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


@contextmanager
def house_style() -> Iterator[None]:
    """The settings above, inside the `with` alone; figures are made without pyplot, so nothing stays."""
    import matplotlib

    with matplotlib.rc_context(SETTINGS):
        yield


def few_ticks(axes: "Axes") -> None:
    """So few labels along the bottom that they never touch, however wide the numbers."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))


def inline(figure: "Figure", name: str, alt: str) -> "Markup":
    """The figure as `<svg>` (or `<img>`), to be called inside `house_style`.

    `name` is unique on the page: it goes before every id, which would clash between two drawings otherwise.
    `alt` says in words what the drawing shows.
    """
    import matplotlib
    from markupsafe import Markup, escape

    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})  # without a date: the same data, the same page
    svg = buffer.getvalue()
    if len(svg.encode()) > LARGEST_SVG:
        return Markup('<img class="paper" src="data:image/png;base64,{}" alt="{}">').format(_png(figure), alt)
    return Markup(_in_page_colours(_own_ids(_bare(svg), name), str(escape(alt))))


def _png(figure: "Figure") -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=PNG_DPI, facecolor="white", metadata={"Software": None})
    return base64.b64encode(buffer.getvalue()).decode()


def _bare(svg: str) -> str:
    """Without prologue and metadata, which name hosts; without a size and a font, which the page decides;
    and with coordinates to 0.01 of a point, which halves the size."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font-family: [^;\"]*;? ?", "", svg)
    svg = re.sub(r"<[^>]*>", lambda tag: re.sub(r"(?<=\d\.\d\d)\d+", "", tag[0]), svg)  # and not the words between
    head, rest = svg.split(">", 1)
    head = re.sub(r'\s(width|height|version|xmlns|xmlns:xlink)="[^"]*"', "", head)
    return f"{head}>{rest}".replace("xlink:href", "href").strip()


def _own_ids(svg: str, name: str) -> str:
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    return re.sub(r'(url\(|href=")#', rf"\1#{name}-", svg)


def _in_page_colours(svg: str, alt: str) -> str:
    for property_, colour in COLOURS.items():
        svg = svg.replace(colour, f"var(--{property_})")
    return svg.replace("<svg", f'<svg role="img" aria-label="{alt}"', 1)
