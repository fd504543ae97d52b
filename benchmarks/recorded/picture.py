"""The gap of one robot after each effect is added, as a picture beside the page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.recorded.words import steps_of


def staged_picture(stages: list[dict[str, Any]], path: Path) -> None:
    """The gap after each effect is added, as bars."""
    from matplotlib.figure import Figure

    added = ["nominal", *(f"+ {c['effect'].replace('_', ' ')} {c['target'] or ''}".strip() for c in steps_of(stages))]
    figure = Figure(figsize=(7.2, 0.4 * len(stages) + 0.9), layout="constrained")
    axes = figure.subplots()
    bars = axes.barh(range(len(stages)), [s["gap"] for s in stages], color=["0.6", *["tab:blue"] * (len(stages) - 1)])
    axes.bar_label(bars, fmt="%.3f", padding=3)
    axes.set_yticks(range(len(stages)), added)
    axes.invert_yaxis()
    axes.set_xlabel("gap, all windows")
    axes.margins(x=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=120)
