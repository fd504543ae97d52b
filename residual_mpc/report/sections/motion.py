"""The robot in the windows that show the gap best: measured, predicted and corrected over each other."""

import base64

from residual_mpc.report.evidence.clock import since_start
from residual_mpc.report.evidence.evidence import Clip, Evidence
from residual_mpc.report.motion import animation
from residual_mpc.report.sections.section import Document, Section, render
from residual_mpc.report.words.numbers import listed, number


def motion(document: Document, evidence: Evidence) -> Section | None:
    """There where clips were drawn, or where it is known why they were not."""
    if not evidence.clips and not evidence.drawing:
        return None
    clips, drawing = encoded(evidence)
    assumed = {c for clip in evidence.clips for c in clip.assumed} if clips else set()
    body = render(
        "sections/motion.html.jinja",
        clips=clips,
        drawing=drawing,
        assumed=listed(sorted(assumed) or [""]),
        explained=any(clip.after is not None for clip in evidence.clips),
        horizon=document["gap"]["horizon"],
    )
    return Section("motion", "The robot's motion", body)


def encoded(evidence: Evidence) -> tuple[list[Document], str]:
    """The clips as the template shows them, and how they were drawn; none, and why, where Pillow cannot write them: a
    report is not lost with its pictures."""
    try:
        return [_shown(clip, evidence) for clip in evidence.clips], evidence.drawing
    except Exception as error:  # whatever an encoder raises, such as that of a Pillow built without WebP
        return [], f"The motion could not be shown ({type(error).__name__}: {error})."


def _shown(clip: Clip, evidence: Evidence) -> Document:
    start = since_start(evidence, clip.run, clip.start)
    speed = clip.seconds / animation.screen_seconds(clip)
    height, width = clip.frames.shape[1:3]
    removed = "" if clip.after is None else f", and {number(clip.after, 2)} with the named effects"
    return {
        "title": (text := " and ".join(clip.shows))[:1].upper() + text[1:],
        "run": clip.run,
        "from": start,
        "to": start + clip.seconds,
        "before": clip.before,
        "after": clip.after,
        "speed": "" if abs(speed - 1.0) < 0.05 else f"shown at {number(speed, 2)} times real speed",
        "moving": base64.b64encode(animation.moving(clip)).decode(),
        "still": base64.b64encode(animation.still(clip)).decode(),
        "width": width,
        "height": height,
        "alt": f"The robot in {clip.run} from {number(start, 4)} to {number(start + clip.seconds, 4)} s: its predicted "
        f"motion over its measured one. The gap of this window is {number(clip.before, 2)}{removed}.",
    }
