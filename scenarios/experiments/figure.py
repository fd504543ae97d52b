"""An experiment's figure, as the paper draws it: reference orange, model dark blue, H2 norm light blue, over time."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from residual_mpc.learning.h2 import running_mean
from residual_mpc.learning.stream.samples import initial_memory, predict
from scenarios.experiments.experiment import Experiment
from scenarios.experiments.setting import SeedResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ORANGE, DARK, LIGHT, GREY = "#e08214", "#08306b", "#6baed6", "#888888"
SHOWN = 20.0  # s, of the beginning and of the end


def draw(experiment: Experiment, done: Mapping[str, Sequence[SeedResult]], path: Path) -> None:
    """Components of the first seed at the beginning and at the end; H2 norms of all seeds; a PNG."""
    from matplotlib.figure import Figure

    first, *others = experiment.forms
    result = done[first][0]
    s, v = result.setting.samples, result.streamed.velocity
    t = s.t[: len(v)] - s.t[0]
    bare = predict((), s, initial_memory(s)).velocity
    components = len(experiment.labels)
    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    grid = figure.add_gridspec(components + 2, 2, height_ratios=[1.0] * components + [1.0, 1.4])
    for k, label in enumerate(experiment.labels):
        most = 1.25 * max(float(np.nanquantile(np.abs(s.reference[:, k]), 0.99)), 1e-9)
        for column, begin in enumerate((0.0, t[-1] - SHOWN)):
            axes = figure.add_subplot(grid[k, column])
            now = (t >= begin) & (t <= begin + SHOWN)
            axes.plot(t[now], s.reference[: len(v)][now, k], color=ORANGE, lw=0.8, label="reference")
            axes.plot(t[now], bare[: len(v)][now, k], color=GREY, lw=0.9, label="model alone")
            axes.plot(t[now], v[now, k], color=DARK, lw=1.1, label="model with network")
            axes.set_ylim(-most, most)
            if column == 0:
                axes.set_ylabel(label, fontsize=8)
            if k == 0:
                axes.set_title("the beginning" if column == 0 else "the end", fontsize=9, loc="left")
            if k == 0 and column == 1:
                axes.legend(fontsize=7, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False)
    below = figure.add_subplot(grid[components, :])
    error = np.abs(s.reference[: len(v)] - v)
    for k, label in enumerate(experiment.labels):
        below.plot(t, running_mean(error[:, k], s.step), lw=1.1, label=label.partition(" (")[0])
    below.set_ylabel("errors,\nmean over 10 s", fontsize=8)
    below.legend(fontsize=7, ncols=3)
    h2 = figure.add_subplot(grid[components + 1, :])
    base = np.linalg.norm(s.reference - bare, axis=1)[: len(v)]
    h2.plot(t, result.streamed.h2, color=LIGHT, lw=0.5, alpha=0.8, label="H2 norm")
    h2.plot(t, running_mean(base, s.step), color=GREY, lw=1.2, label="model alone, mean over 10 s")
    for form, style in ((first, "-"), *((f, "--") for f in others)):
        mean = np.nanmean([x.streamed.h2 for x in done[form]], axis=0)
        h2.plot(t, running_mean(mean, s.step), style, color=DARK, lw=1.3, label=f"{form} form, {len(done[form])} seeds")
    h2.set(xlabel="s of data", ylim=(0.0, 1.3 * float(np.nanquantile(base, 0.97))))
    h2.set_ylabel("H2 norm", fontsize=8)
    h2.legend(fontsize=7, ncols=4, loc="upper right")
    for axes in figure.axes:
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    figure.suptitle(f"{experiment.name}: {experiment.summary}", fontsize=10)
    _save(figure, path)


def _save(figure: "Figure", path: Path) -> None:
    """A PNG of few colours: a third of the size."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure.set_dpi(80)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    picture.quantize(64).save(path, optimize=True)
