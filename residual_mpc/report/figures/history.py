"""The gap over the time of a stream, as an SVG that follows the page's colours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from residual_mpc.report.sections.section import render
from residual_mpc.report.words.numbers import number

if TYPE_CHECKING:
    from markupsafe import Markup

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 720.0, 240.0, 56.0, 10.0, 34.0  # px of the drawing


@dataclass(frozen=True)
class Point:
    """seconds: of the stream; reference: the gap of steady running, None where it is not known; changed: whether a
    change was told here."""

    seconds: float
    gap: float
    reference: float | None
    evidence: float
    changed: bool


def history_svg(points: Sequence[Point]) -> "Markup | None":
    """None while there is nothing to draw."""
    shown = [p for p in points if not p.changed]
    if len(shown) < 2:
        return None
    start, end = shown[0].seconds, max(shown[-1].seconds, shown[0].seconds + 1.0)
    top = 1.1 * max(max(p.gap, p.reference or 0.0) for p in shown) or 1.0

    def x(seconds: float) -> float:
        return round(LEFT + (WIDTH - LEFT - 8.0) * (seconds - start) / (end - start), 1)

    def y(gap: float) -> float:
        return round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * gap / top, 1)

    minutes = end - start > 180.0
    unit = 60.0 if minutes else 1.0
    references = [p for p in shown if p.reference is not None]
    return render(
        "history.svg.jinja",
        width=WIDTH, height=HEIGHT, left=LEFT, bottom=HEIGHT - BOTTOM,
        line=" ".join(f"{x(p.seconds)},{y(p.gap)}" for p in shown),
        reference=" ".join(f"{x(p.seconds)},{y(p.reference or 0.0)}" for p in references),
        changes=[x(p.seconds) for p in points if p.changed],
        rows=[(y(top * k / 3.3), number(top * k / 3.3, 2)) for k in range(4)],
        ticks=[(x(start + (end - start) * k / 4), number((start + (end - start) * k / 4) / unit, 2)) for k in range(5)],
        unit="min" if minutes else "s",
        alt=f"The gap over {number((end - start) / unit)} {'min' if minutes else 's'} of the stream.",
    )  # fmt: skip
