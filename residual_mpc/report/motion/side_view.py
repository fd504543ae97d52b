"""A robot that does not drive, from the side on which its motions differ most: the camera, and a plain drawing."""

import numpy as np

from residual_mpc.models.drawing import Camera, Size
from residual_mpc.report.motion.ink import FINE

AZIMUTHS = range(0, 180, 15)  # degrees; the opposite side shows the same
ELEVATION = -15.0  # degrees: slightly from above
MARGIN = 0.14  # of the picture, around what is shown
LEAST = 0.05  # m
THICK = 0.036  # of the view's height: a limb
BALL = 1.5  # times that: a joint
LIMB = 200  # brightness of a limb that no renderer drew


def side_view(skeletons: np.ndarray, size: Size) -> Camera:
    """A camera for skeletons (N, F, S, 2, 3) m, the first of which is the measured one."""
    azimuth = max(AZIMUTHS, key=lambda a: _apart(skeletons, Camera((0.0, 0.0, 0.0), float(a), ELEVATION, 1.0)))
    axes = Camera((0.0, 0.0, 0.0), float(azimuth), ELEVATION, 1.0).axes
    seen = skeletons.reshape(-1, 3) @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height = size
    tall = max(float(high[1] - low[1]), float(high[0] - low[0]) * height / width, LEAST)
    target = (0.5 * (low + high)) @ axes
    return Camera((float(target[0]), float(target[1]), float(target[2])), float(azimuth), ELEVATION,
                  tall / (1.0 - 2.0 * MARGIN))  # fmt: skip


def limbs(skeletons: np.ndarray, camera: Camera, size: Size) -> np.ndarray:
    """(N, F, height, width) uint8: skeletons (N, F, S, 2, 3) m as rounded limbs."""
    from PIL import Image, ImageDraw

    width, height = size
    places = FINE * camera.project(skeletons, size)
    thick = FINE * THICK * height
    out = []
    for frame in places.reshape(-1, *places.shape[2:]):
        fine = Image.new("L", (FINE * width, FINE * height), 0)
        draw = ImageDraw.Draw(fine)
        for a, b in frame:
            draw.line((*a, *b), fill=LIMB, width=round(thick))
            for x, y in (a, b):
                r = 0.5 * BALL * thick
                draw.ellipse((x - r, y - r, x + r, y + r), fill=LIMB)
        out.append(np.asarray(fine.reduce(FINE)))
    return np.stack(out).reshape(*skeletons.shape[:2], height, width)


def _apart(skeletons: np.ndarray, camera: Camera) -> float:
    """How far the motions are from the measured one as the camera sees them, less where the robot hides itself."""
    seen = camera.project(skeletons, (2, 1))
    far = float(np.sqrt(np.mean((seen[1:] - seen[:1]) ** 2))) if len(seen) > 1 else 0.0
    wide = float(np.ptp(seen[0].reshape(-1, 2), axis=0).min())
    return far * (0.3 + wide)
