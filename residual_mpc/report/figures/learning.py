"""The norm of the prediction error while a network learns, over the data that it has seen."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.report.figures.inline import COLOURS, house_style, inline
from residual_mpc.report.words.numbers import number

if TYPE_CHECKING:
    from markupsafe import Markup

SIZE = (7.2, 2.8)  # inches


def learning_curve(history: Sequence[Sequence[float]], converged_after: float | None, name: str) -> "Markup":
    """history: (s of data, H2 norm) in order; `name` is unique on the page."""
    from matplotlib.figure import Figure

    seconds, norm = np.asarray(history, dtype=float).T
    with house_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        axes.plot(seconds, norm, color=COLOURS["after"])
        if converged_after is not None:
            axes.axvline(converged_after, color=COLOURS["floor"], ls=":", lw=1.4)
        axes.set(xlabel="data seen (s)", ylabel="H2 norm")
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.01)
        ends = f"{number(norm[0])} at first, {number(norm[-1])} at last"
        return inline(figure, name, f"The H2 norm over {number(seconds[-1])} s of data: {ends}.")
