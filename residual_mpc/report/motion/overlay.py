"""Several motions of one robot in one picture: its shapes over each other, their trails, and a legend."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.models.drawing import Size
from residual_mpc.report.motion.ink import FINE, INKS, MEASURED, MUTED, PAPER, Ink, font, line

if TYPE_CHECKING:
    from PIL.Image import Image

STRIP = 30  # px below the picture, for the legend
LETTERS = 14  # px
EDGE = 96  # brightness from which a pixel belongs to the robot in full
OUTLINE = 2  # px
DASH = 5  # px of a dashed outline


def overlay(
    background: "Image", shades: np.ndarray, trails: np.ndarray, seconds: float, inks: Sequence[Ink] = INKS
) -> np.ndarray:
    """(F, height + STRIP, width, 3) uint8.

    shades (N, F, height, width) uint8: brightness of the robot in each motion, 0 where it is not; trails (N, F, 2) px:
    where its point is at each instant; seconds: from the first instant to the last.
    """
    base = np.asarray(background)
    clock = np.linspace(0.0, seconds, shades.shape[1])
    return np.stack(
        [
            _with_strip(_lines(_shapes(base, shades[:, f], inks), trails[:, : f + 1], inks), clock[f], inks)
            for f in range(shades.shape[1])
        ]
    )


def _shapes(base: np.ndarray, shades: np.ndarray, inks: Sequence[Ink]) -> np.ndarray:
    """(height, width, 3) uint8: the shapes (N, height, width) over the background, each in its ink."""
    out = base.copy()
    if not shades.any():
        return out
    box = _box(np.asarray(shades.any(axis=0)))
    drawn = [(shade[box], ink) for shade, ink in zip(shades, inks, strict=False)]
    within = out[box].astype(float)
    for shade, ink in drawn[::-1]:  # the measured one over the others
        alpha = np.minimum(shade / EDGE, 1.0)[..., None]
        light = (0.75 + 0.5 * shade / 255.0)[..., None]
        lit = np.clip(np.array(ink.colour) * light + 30.0 * (light - 0.75), 0, 255)
        within += ink.fill * alpha * (lit - within)
    for shade, ink in drawn:
        if ink.fill != MEASURED.fill:
            within[_outline(shade >= EDGE // 2, ink, box[0].start + box[1].start)] = ink.colour
    out[box] = np.clip(within, 0, 255)
    return out


def _box(covered: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns of a picture in which a mask (height, width) is true, and an outline's width around them."""
    rows, columns = (np.flatnonzero(covered.any(axis=axis)) for axis in (1, 0))
    high, wide = (slice(max(k[0] - OUTLINE, 0), k[-1] + 1 + OUTLINE) for k in (rows, columns))
    return high, wide


def _outline(inside: np.ndarray, ink: Ink, first: int) -> np.ndarray:
    """(height, width) bool: the outermost pixels of a shape, broken where the ink is dashed; first: row + column of the
    first pixel in the picture."""
    core = inside.copy()
    for _ in range(OUTLINE):
        inner = core.copy()
        inner[1:] &= core[:-1]
        inner[:-1] &= core[1:]
        inner[:, 1:] &= core[:, :-1]
        inner[:, :-1] &= core[:, 1:]
        core = inner
    edge = inside & ~core
    if ink.dash is not None:
        rows, columns = np.indices(edge.shape)
        edge &= (rows + columns + first) // DASH % 2 == 0
    return np.asarray(edge)


def _lines(picture: np.ndarray, trails: np.ndarray, inks: Sequence[Ink]) -> "Image":
    """The picture (height, width, 3) uint8 with the trails (N, f, 2) px so far, and a dot where each ends."""
    from PIL import Image, ImageDraw

    size = np.array(picture.shape[1::-1])
    flat = Image.fromarray(picture)
    known = [(trail[np.isfinite(trail).all(axis=1)], ink) for trail, ink in zip(trails, inks, strict=False)]
    drawn = np.concatenate([there for there, _ in known])
    reach = max(ink.width for ink in inks) + 2.0  # of a line's ends and of a dot, px
    low = np.clip(np.floor(drawn.min(axis=0) - reach), 0, size).astype(int)
    high = np.clip(np.ceil(drawn.max(axis=0) + reach), 0, size).astype(int)
    if (high <= low).any():
        return flat
    box = (*low.tolist(), *high.tolist())
    # only the part with lines is enlarged and averaged
    fine = flat.crop(box).resize(tuple(FINE * (high - low)), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(fine)
    for there, ink in known:
        line(draw, there - low, ink)
        x, y = FINE * (there[-1] - low)
        r = FINE * (ink.width + 1.0)
        draw.ellipse((x - r, y - r, x + r, y + r), fill=ink.colour, outline=PAPER, width=FINE)
    flat.paste(fine.reduce(FINE), box)
    return flat


def _with_strip(picture: "Image", t: float, inks: Sequence[Ink]) -> np.ndarray:
    """The picture over a legend and the time since the window's start, s."""
    from PIL import Image

    out = Image.new("RGB", (picture.width, picture.height + STRIP), PAPER)
    out.paste(picture, (0, 0))
    out.paste(_strip((picture.width, STRIP), f"{t:.2f} s", inks), (0, picture.height))
    return np.asarray(out)


def _strip(size: Size, clock: str, inks: Sequence[Ink]) -> "Image":
    from PIL import Image, ImageDraw

    fine = Image.new("RGB", (FINE * size[0], FINE * size[1]), PAPER)
    draw = ImageDraw.Draw(fine)
    letters, x, middle = font(FINE * LETTERS), 10.0, 0.5 * size[1]
    for ink in inks:
        line(draw, np.array([[x, middle], [x + 26.0, middle]]), ink)
        draw.text((FINE * (x + 33.0), FINE * middle), ink.name, fill=ink.colour, font=letters, anchor="lm")
        x += 33.0 + draw.textlength(ink.name, font=letters) / FINE + 16.0
    draw.text((FINE * (size[0] - 10), FINE * middle), clock, fill=MUTED, font=letters, anchor="rm")
    return fine.reduce(FINE)
