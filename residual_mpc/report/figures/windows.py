"""How the gap spreads over the windows: in how many of them the model misses by less than so much."""

from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.report.evidence.evidence import Array
from residual_mpc.report.figures.inline import COLOURS, house_style, inline

if TYPE_CHECKING:
    from markupsafe import Markup

SIZE = (5.4, 2.5)  # inches


def spread(before: Array, after: Array | None, floor: float, name: str) -> "Markup":
    """The share of windows (y) whose gap is below x. `before`, `after`: (w,) finite gaps of windows."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import PercentFormatter

    with house_style():
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        axes.ecdf(before, color=COLOURS["before"], ls=(0, (4, 1.6)))
        if after is not None:
            axes.ecdf(after, color=COLOURS["after"])
        axes.axvline(floor, color=COLOURS["floor"], ls=":", lw=1.4)
        axes.set_xlim(left=0.0, right=float(np.quantile(before, 0.98)) * 1.1 or 1.0)
        axes.set_ylim(0.0, 1.02)
        axes.set_xlabel("gap per window")
        axes.set_ylabel("share of windows")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        return inline(figure, name, _alt(before, after, floor))


def _alt(before: Array, after: Array | None, floor: float) -> str:
    middle = f"The median gap of the {before.size} windows is {np.median(before):.2g} before"
    then = "" if after is None else f" and {np.median(after):.2g} after"
    return f"{middle}{then}; the noise floor is {floor:.2g}."
