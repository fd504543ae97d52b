"""What the controllers were to follow and what the robot did, and how far apart the two were."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from residual_mpc.report.figures.controllers import line_of
from residual_mpc.report.figures.inline import COLOURS, house_style, inline
from residual_mpc.report.words.numbers import number

if TYPE_CHECKING:
    from markupsafe import Markup

    from residual_mpc.report.drive import Driven

PLANE = ("pose.x", "pose.y")
CHANNELS = 4  # drawn of a reference that is no path in the plane


def paths(driven: "Sequence[Driven]", unit: str, name: str) -> "Markup":
    """The path in the plane, or the channels over time; `name` is unique on the page."""
    from matplotlib.figure import Figure

    first = driven[0]
    plane = [first.channels.index(c) for c in PLANE if c in first.channels]
    flat = len(plane) == 2
    rows = 1 if flat else min(CHANNELS, len(first.channels))
    with house_style():
        figure = Figure(figsize=(5.4, 4.2 if flat else 1.0 + 1.3 * rows), layout="constrained")
        axes = np.atleast_1d(figure.subplots(rows, 1, sharex=not flat))
        for k, one in enumerate(axes):
            for d in driven[:1]:
                _line(one, d.t, d.wanted, plane if flat else [k], color=COLOURS["ink"], lw=3.0, alpha=0.45)
            for d in driven:
                _line(one, d.t, d.driven, plane if flat else [k], **line_of(d.name).style())
            one.set_ylabel("y (m)" if flat else f"{first.channels[k].partition('.')[2]} ({unit})")
        axes[-1].set_xlabel("x (m)" if flat else "time (s)")
        if flat:
            axes[0].set_aspect("equal", adjustable="datalim")
        return inline(figure, name, "The reference, and what the robot did with each controller.")


def error_over_time(driven: "Sequence[Driven]", unit: str, name: str) -> "Markup":
    """The mean distance from the reference over the seeds; `name` is unique on the page."""
    from matplotlib.figure import Figure

    with house_style():
        figure = Figure(figsize=(5.4, 4.2), layout="constrained")
        axes = figure.add_subplot()
        for d in driven:
            axes.plot(d.t, 1e3 * d.error, **line_of(d.name).style())
        axes.set(xlabel="time (s)", ylabel=f"distance from the reference (m{unit})")
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
        said = ", ".join(f"{d.name} {number(1e3 * float(np.sqrt(np.mean(d.error**2))), 2)} m{unit}" for d in driven)
        return inline(figure, name, f"The distance from the reference over time; RMS: {said}.")


def _line(axes: Any, t: np.ndarray, y: np.ndarray, columns: list[int], **style: Any) -> None:
    """Two columns against each other, or one over the time."""
    if len(columns) == 2:
        axes.plot(y[:, columns[0]], y[:, columns[1]], **style)
    else:
        axes.plot(t, y[:, columns[0]], **style)
