"""How the motions are told apart, with colour and without, and the lines and letters of all pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.report.figures.inline import COLOURS

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

FINE = 2  # lines are drawn this many times as large, then averaged: Pillow's own have steps
PAPER = (247, 248, 250)  # of the page in light colours; the pictures keep it in dark ones


@dataclass(frozen=True)
class Ink:
    """name: in the legend; colour: red, green, blue; fill: opacity of the robot's shape, from 0 to 1; width of the
    trail, px; dash: px drawn and px left out, None for a solid line."""

    name: str
    colour: tuple[int, int, int]
    fill: float
    width: float
    dash: tuple[float, float] | None


def _rgb(code: str) -> tuple[int, int, int]:
    return int(code[1:3], 16), int(code[3:5], 16), int(code[5:7], 16)


MEASURED = Ink("measured", _rgb(COLOURS["ink"]), 0.85, 4.0, None)
PREDICTED = Ink("predicted", _rgb(COLOURS["before"]), 0.40, 2.4, (8.0, 5.0))
CORRECTED = Ink("corrected", _rgb(COLOURS["after"]), 0.40, 2.0, None)
INKS = (MEASURED, PREDICTED, CORRECTED)
MUTED, GRID = _rgb(COLOURS["muted"]), _rgb(COLOURS["grid"])


@cache
def font(size: int) -> "FreeTypeFont":
    """The typeface that matplotlib brings along, at `size` px."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def line(draw: "ImageDraw", points: np.ndarray, ink: Ink) -> None:
    """Draw a line through points (n, 2) px of the finished picture, on one FINE times as large."""
    points = np.asarray(points, dtype=float) * FINE
    width = max(1, round(ink.width * FINE))
    for part in [points] if ink.dash is None else _dashes(points, *(FINE * x for x in ink.dash)):
        corners = [tuple(p) for p in part]
        if len(corners) > 1:
            draw.line(corners, fill=ink.colour, width=width, joint="curve")


def _dashes(points: np.ndarray, drawn: float, skipped: float) -> Sequence[np.ndarray]:
    """The pieces of a dashed line through points (n, 2)."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    out = []
    for first in np.arange(0.0, length[-1], drawn + skipped):
        last = min(first + drawn, length[-1])
        inner = points[(length > first) & (length < last)]
        ends = [[np.interp(s, length, points[:, k]) for k in (0, 1)] for s in (first, last)]
        out.append(np.concatenate([ends[:1], inner, ends[1:]]))
    return out
