"""Runs in which a joint goes round, as it does in no other: a network that takes its angle cannot serve both."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from residual_mpc.logs.run import Run

TURN = 2.0 * np.pi
FARTHER = 3.0  # times as far as in the median of the other runs


def turned_over(
    runs: Sequence[Run], inputs: Sequence[str], sliding: frozenset[str] = frozenset()
) -> list[dict[str, Any]]:
    """The runs in which one of the network's angles goes over more than a turn, and far more than in most other runs.
    sliding: joints that have no angle."""
    out = []
    for channel in (i for i in inputs if i.startswith("position.") and i.partition(".")[2] not in sliding):
        measured = {r.name: r.columns[channel] for r in runs if np.isfinite(r.columns.get(channel, np.nan)).any()}
        ranges = {name: float(np.nanmax(x) - np.nanmin(x)) for name, x in measured.items()}
        for name, size in ranges.items():
            others = [x for other, x in ranges.items() if other != name]
            usual = float(np.median(others)) if others else np.inf
            if size > max(TURN, FARTHER * usual):
                out.append({"run": name, "channel": channel, "range": size, "usual": usual})
    return out
