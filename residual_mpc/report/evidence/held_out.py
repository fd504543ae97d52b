"""Which windows no fit has seen: the runs, or the blocks of runs, that the document lists as held out."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from residual_mpc.report.evidence.evidence import Windows


def held_out(document: Mapping[str, Any], windows: Windows) -> NDArray[np.bool_]:
    """(w,) true where the window is among the runs or blocks in `document["held_out"]`."""
    names = np.asarray(windows.run, dtype=str)
    middle = windows.start + 0.5 * document["gap"]["horizon"]
    mask = np.zeros(names.shape, dtype=bool)
    for part in document["held_out"]:
        if isinstance(part, str):
            mask |= names == part
        else:
            mask |= (names == part["run"]) & (middle >= part["from"]) & (middle < part["to"])
    return mask
