"""Frames as files: an animation and a still for the page, and a video for everything else."""

import io
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.files import write_bytes_atomically
from residual_mpc.report.evidence.evidence import Clip
from residual_mpc.report.motion.ink import FINE, MUTED, PAPER, font

SHORTEST, LONGEST = 2.0, 6.0  # s that a clip takes on the screen
SLOWER = 2.0  # times, within those limits
HOLD = 1.0  # s that the last frame stays
QUALITY = 72  # of a lossy WebP, 0 to 100
SUFFIXES = (".mp4", ".gif", ".webp")
TITLE = 34  # px over the frames of a video


def screen_seconds(clip: Clip) -> float:
    """s from the first frame to the last one as they are shown."""
    return float(np.clip(SLOWER * clip.seconds, SHORTEST, LONGEST))


def moving(clip: Clip) -> bytes:
    """The clip as an animated WebP that begins again for ever."""
    return _animated([clip.frames], [_durations(clip)], "WEBP")


def still(clip: Clip) -> bytes:
    """The frame that stands for the clip, as a WebP."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(clip.frames[clip.still]).save(out, format="WEBP", quality=QUALITY + 10, method=6)
    return out.getvalue()


def check_video(path: Path) -> None:
    """Raises BadInput for a file that `write_video` cannot write here."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise BadInput(f"cannot write a video to {path.name!r}", "`video`", f"end the name in one of {known}")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise BadInput("an .mp4 needs ffmpeg, which is not on the PATH", "`video`",
                       "install ffmpeg, or end the name in .webp or .gif")  # fmt: skip


def write_video(clips: Sequence[Clip], path: Path) -> None:
    """All clips, one after the other, each with a title. Raises BadInput for a file that cannot be written."""
    check_video(path)
    titled = [np.stack([_with_title(f, clip) for f in clip.frames]) for clip in clips]
    durations = [_durations(clip) for clip in clips]
    if path.suffix.lower() == ".mp4":
        content = _mp4(titled, durations)
    else:
        content = _animated(titled, durations, path.suffix[1:].upper())
    write_bytes_atomically(path, content)


def title(clip: Clip) -> str:
    """ "Largest gap and largest correction, run 3"."""
    text = " and ".join(clip.shows)
    return f"{text[:1].upper()}{text[1:]}, {clip.run}"


def _durations(clip: Clip) -> list[int]:
    """ms of each frame."""
    each = 1000.0 * screen_seconds(clip) / max(len(clip.frames) - 1, 1)
    return [*[round(each)] * (len(clip.frames) - 1), round(1000.0 * HOLD)]


def _animated(films: Sequence[np.ndarray], durations: Sequence[list[int]], kind: str) -> bytes:
    from PIL import Image

    pictures = [Image.fromarray(f) for film in films for f in film]
    out = io.BytesIO()
    more = {"quality": QUALITY, "method": 2, "kmax": 0} if kind == "WEBP" else {}
    pictures[0].save(
        out, format=kind, save_all=True, append_images=pictures[1:], duration=sum(durations, []), loop=0, **more
    )
    return out.getvalue()


def _mp4(films: Sequence[np.ndarray], durations: Sequence[list[int]]) -> bytes:
    """By ffmpeg, as H.264, at 25 frames a second. Raises BadInput where it fails."""
    import tempfile

    rate = 25.0
    frames = [f for film, ms in zip(films, durations, strict=True) for f, d in zip(film, ms, strict=True)
              for _ in range(max(1, round(rate * d / 1000.0)))]  # fmt: skip
    height, width = (x - x % 2 for x in frames[0].shape[:2])  # H.264 halves both
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "video.mp4"
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"]
        command = ["ffmpeg", "-loglevel", "error", *raw, "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(made)]
        whole = b"".join(np.ascontiguousarray(f[:height, :width]).tobytes() for f in frames)
        done = subprocess.run(command, input=whole, capture_output=True, check=False)
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
            raise BadInput(f"ffmpeg failed: {said[0]}", "`video`", "end the name in .webp or .gif")
        return made.read_bytes()


def _with_title(frame: np.ndarray, clip: Clip) -> np.ndarray:
    from PIL import Image, ImageDraw

    height, width = frame.shape[:2]
    out = Image.new("RGB", (width, height + TITLE), PAPER)
    band = Image.new("RGB", (FINE * width, FINE * TITLE), PAPER)
    ImageDraw.Draw(band).text((FINE * 10, FINE * TITLE / 2), title(clip), MUTED, font(FINE * 15), anchor="lm")
    out.paste(band.reduce(FINE), (0, 0))
    out.paste(Image.fromarray(frame), (0, TITLE))
    return np.asarray(out)
