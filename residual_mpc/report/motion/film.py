"""From a finished diagnosis to its clips: the windows that are worth it, drawn as the robot allows."""

from collections.abc import Callable, Sequence

import numpy as np

from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.models.drawing import NoRenderer, Size, outline, shade, skeleton
from residual_mpc.models.protocol import Robot
from residual_mpc.report.evidence.evidence import Clip
from residual_mpc.report.motion.choose import best_window, chosen_windows, window_gaps
from residual_mpc.report.motion.ghosts import FRAMES, Ghosts, block_of, ghosts
from residual_mpc.report.motion.ink import INKS, PAPER, Ink
from residual_mpc.report.motion.long_windows import over_longest
from residual_mpc.report.motion.overlay import overlay
from residual_mpc.report.motion.side_view import limbs, side_view
from residual_mpc.report.motion.top_view import ground, path, shapes, top_view

SIZE = (560, 400)  # px, without the legend
LONG_FRAMES = 61
PLANAR = ("pose.x", "pose.y", "pose.theta")
ABOVE = "Seen from above."
UNMEASURED = "No position of the robot was logged, so its motion cannot be drawn."
SHAPELESS = "This robot's model says nothing of its shape, so its motion cannot be drawn."

Drawn = tuple[np.ndarray, int, str]  # frames, the one that stands for all, how they were drawn


def film(made: DiagnosisResult) -> tuple[tuple[Clip, ...], str]:
    """The clips, and how they were drawn or why there are none.

    It never raises: the answer of a diagnosis does not depend on its pictures.
    """
    try:
        return _film(made)
    except Exception as error:  # whatever a plant's drawing or a graphics library raises
        return (), f"The motion could not be drawn ({type(error).__name__}: {error})."


def _film(made: DiagnosisResult) -> tuple[tuple[Clip, ...], str]:
    windows = chosen_windows(made)
    if not windows:
        return (), UNMEASURED
    clips: list[Clip] = []
    how = ""
    for of, window, shows, frames in [*_long(made), *((made, w, shows, FRAMES) for w, shows in windows.items())]:
        motions = ghosts(of, window, frames)
        drawn = draw(block_of(of.data, window).robot, motions)
        if drawn is None:
            return (), SHAPELESS
        pictures, still, how = drawn
        before, after = window_gaps(of)
        run = of.data.runs[of.data.run[window]].name
        removed = float(after[window]) if of.diagnosis.causes else None
        clips.append(
            Clip(shows, run, float(of.data.start[window]), float(before[window]), removed, pictures, still,
                 motions.seconds, motions.assumed)
        )  # fmt: skip
    return tuple(clips), how


def _long(made: DiagnosisResult) -> list[tuple[DiagnosisResult, int, tuple[str, ...], int]]:
    """Of a robot that drives: the window of the longest horizon in which the named effects do most, if there is one."""
    whole = over_longest(made) if drives(block_of(made.data, 0).robot) else None
    window = None if whole is None else best_window(whole)
    if whole is None or window is None:
        return []
    look = max(made.diagnosis.gap.horizons, key=lambda h: h.horizon)
    title = f"{look.horizon:g} s from one start" + ("" if look.held_out else " (not held out)")
    return [(whole, window, (title,), LONG_FRAMES)]


def drives(robot: Robot) -> bool:
    return set(PLANAR) <= {s.position for s in robot.states}


def draw(robot: Robot, motions: Ghosts, size: Size = SIZE, inks: Sequence[Ink] = INKS) -> Drawn | None:
    """The motions over each other; None of a robot that has neither a pose nor a skeleton."""
    how: Callable[[Robot, Ghosts, Size, Sequence[Ink]], Drawn | None]
    how = _from_above if set(PLANAR) <= set(motions.measured) else _from_the_side
    return how(robot, motions, size, inks)


def _from_above(robot: Robot, motions: Ghosts, size: Size, inks: Sequence[Ink]) -> Drawn:
    some, body = motions.motions, outline(robot)
    view = top_view(some, body, size)
    trails = np.stack([view.place(path(m)) for m in some])
    frames = overlay(ground(view), shapes(some, body, view), trails, motions.seconds, inks[: len(some)])
    return frames, _farthest(trails), ABOVE


def _from_the_side(robot: Robot, motions: Ghosts, size: Size, inks: Sequence[Ink]) -> Drawn | None:
    from PIL import Image

    some = motions.motions
    bones = [skeleton(robot, m) for m in some]
    known = [b for b in bones if b is not None and b.shape[1] > 0]
    if len(known) < len(some):
        return None
    skeletons = np.stack(known)
    camera = side_view(skeletons, size)
    try:
        shades, how = shade(robot, some, camera, size), "Rendered from the model."
    except NoRenderer as none:
        shades, how = limbs(skeletons, camera, size), f"Drawn as a skeleton: {none}."
    trails = camera.project(skeletons[:, :, -1, 1], size)
    background = Image.new("RGB", size, PAPER)
    return overlay(background, shades, trails, motions.seconds, inks[: len(some)]), _farthest(trails), how


def _farthest(trails: np.ndarray) -> int:
    """The frame at which the predicted trail is farthest from the measured one, of trails (N, F, 2)."""
    return int(np.argmax(np.linalg.norm(trails[1] - trails[0], axis=-1)))
