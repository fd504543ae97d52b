"""The page of a closed-loop run: its result with the first seed's episodes as the report draws them."""

from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.closed_loop.compare import Comparison
from residual_mpc.closed_loop.episode import Episode
from residual_mpc.closed_loop.metrics import path_error
from residual_mpc.files import write_atomically, write_bytes_atomically
from residual_mpc.models.protocol import Robot
from residual_mpc.report.drive import NAME, Driven, drive_page
from residual_mpc.report.evidence.evidence import Clip
from residual_mpc.report.motion.animation import moving
from residual_mpc.report.motion.drive_film import film_drive

MOTION = "motion.webp"
CORRECTED = ("augmented", "effects")  # the one that is filmed, if it drove


def write_page(out: Path, robot: Robot, comparison: Comparison, result: dict[str, Any]) -> list[str]:
    """Write the page and, where it was drawn, the robot's motion into the folder; returns the names of the files."""
    driven = [
        Driven(name, es[0].poses, es[0].t, es[0].reference, es[0].truth, np.mean([path_error(e) for e in es], axis=0))
        for name, es in comparison.episodes.items()
    ]
    clip = _film(robot, comparison)
    write_atomically(out / NAME, drive_page(result, driven, clip))
    if clip is None:
        return [NAME]
    write_bytes_atomically(out / MOTION, moving(clip))
    return [NAME, MOTION]


def _film(robot: Robot, comparison: Comparison) -> Clip | None:
    """None where one of the two did not drive, lost its path, or cannot be drawn."""
    corrected = next((n for n in CORRECTED if n in comparison.episodes), None)
    if corrected is None or "nominal" not in comparison.episodes:
        return None
    bad, good = comparison.episodes["nominal"][0], comparison.episodes[corrected][0]
    if not (np.isfinite(bad.truth).all() and np.isfinite(good.truth).all()):
        return None
    reference = {c: good.reference[:, i] for i, c in enumerate(good.poses)}
    return film_drive(robot, good.t, reference, _truth(bad), _truth(good))


def _truth(episode: Episode) -> dict[str, np.ndarray]:
    return {c: episode.truth[:, i] for i, c in enumerate(episode.poses)}
