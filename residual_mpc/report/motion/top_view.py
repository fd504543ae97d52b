"""A robot that drives, from above: its outline at its pose, on a grid of metres."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.models.drawing import Motion, Size
from residual_mpc.report.motion.ink import FINE, GRID, MUTED, PAPER, font

if TYPE_CHECKING:
    from PIL.Image import Image

ARROW = 0.05 * np.array([[1.0, 0.0], [-0.8, 0.62], [-0.45, 0.0], [-0.8, -0.62]])  # of the view: an unknown outline
FARTHEST = 3.0  # times the measured motion's extent, beyond which a diverging prediction is not followed
MARGIN = 0.12  # of the picture, around what is shown
LEAST = 0.02  # m, the smallest extent that is shown
TILES = 5  # grid lines over the shorter side, about
INSIDE = 215  # brightness of a filled outline


@dataclass(frozen=True)
class TopView:
    """centre (2,) m, scale px/m: the world in a picture of `size`, x to the right and y up."""

    centre: np.ndarray
    scale: float
    size: Size

    def place(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) px from the upper left corner, of points (..., 2) m."""
        width, height = self.size
        seen = self.scale * (np.asarray(points) - self.centre)
        return np.stack([0.5 * width + seen[..., 0], 0.5 * height - seen[..., 1]], axis=-1)


def path(motion: Motion) -> np.ndarray:
    """(F, 2) m."""
    return np.stack([motion["pose.x"], motion["pose.y"]], axis=-1)


def top_view(motions: tuple[Motion, ...], outline: np.ndarray | None, size: Size) -> TopView:
    """A view that holds all motions, the first of which is the measured one; predictions that run away leave it."""
    own = path(motions[0])
    middle, reach = 0.5 * (own.min(axis=0) + own.max(axis=0)), max(float(np.ptp(own, axis=0).max()), LEAST)
    body = np.zeros((1, 2)) if outline is None else outline
    points = np.concatenate([outlines(m, body).reshape(-1, 2) for m in motions])
    far = FARTHEST * reach + float(np.abs(body).max())
    points = points[np.isfinite(points).all(axis=1)]
    points = np.clip(points, middle - far, middle + far)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = np.maximum(high - low, LEAST)
    scale = float(((1.0 - 2.0 * MARGIN) * np.array(size) / extent).min())
    return TopView(0.5 * (low + high), scale, size)


def shapes(motions: tuple[Motion, ...], outline: np.ndarray | None, view: TopView) -> np.ndarray:
    """(N, F, height, width) uint8: the outline at the pose in each motion, bright inside."""
    from PIL import Image, ImageDraw

    width, height = view.size
    body = ARROW * min(view.size) / view.scale if outline is None else outline
    out = []
    for motion in motions:
        corners = FINE * view.place(outlines(motion, body))
        for frame in np.clip(np.nan_to_num(corners), -1e5, 1e5):
            fine = Image.new("L", (FINE * width, FINE * height), 0)
            ImageDraw.Draw(fine).polygon([tuple(p) for p in frame], fill=INSIDE)
            out.append(np.asarray(fine.reduce(FINE)))
    return np.stack(out).reshape(len(motions), -1, height, width)


def ground(view: TopView) -> "Image":
    """The grid, with the size of a tile."""
    from PIL import Image, ImageDraw

    width, height = view.size
    fine = Image.new("RGB", (FINE * width, FINE * height), PAPER)
    draw = ImageDraw.Draw(fine)
    tile = tile_of(min(view.size) / view.scale)
    half = 0.5 * np.array(view.size) / view.scale
    first, last = np.ceil((view.centre - half) / tile), np.floor((view.centre + half) / tile)
    for axis in (0, 1):
        for k in np.arange(first[axis], last[axis] + 1):
            at = FINE * view.place(np.where(np.arange(2) == axis, k * tile, view.centre))[axis]
            ends = (at, 0, at, FINE * height) if axis == 0 else (0, at, FINE * width, at)
            draw.line(ends, fill=GRID, width=FINE)
    text = f"grid: {tile:g} m" if tile >= 1.0 else f"grid: {100 * tile:g} cm"
    draw.text((FINE * 10, FINE * 8), text, fill=MUTED, font=font(FINE * 13), anchor="la")
    return fine.reduce(FINE)


def tile_of(extent: float) -> float:
    """m: 1, 2 or 5 times a power of ten, of which about TILES make up the extent."""
    rough = extent / TILES
    power = 10.0 ** np.floor(np.log10(rough))
    return float(power * max(f for f in (1.0, 2.0, 5.0) if f * power <= rough * 1.0001))


def outlines(motion: Motion, body: np.ndarray) -> np.ndarray:
    """(F, P, 2) m: the body's points (P, 2) at each pose of the motion."""
    theta = motion["pose.theta"][:, None]
    c, s = np.cos(theta), np.sin(theta)
    x, y = motion["pose.x"][:, None], motion["pose.y"][:, None]
    return np.stack([x + c * body[:, 0] - s * body[:, 1], y + s * body[:, 0] + c * body[:, 1]], axis=-1)
