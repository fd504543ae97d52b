"""How the gap is spread over the windows, and which window has the largest."""

from typing import Any

import numpy as np

from residual_mpc.diagnosis.data.dataset import Dataset


def quantiles(square: np.ndarray, data: Dataset) -> dict[str, Any]:
    """Median, ninth decile and maximum of the windows' own gaps, from their mean scaled squares (W,), and the window of
    the maximum: its run and where it begins, s from the run's first stamp."""
    own = np.sqrt(square)
    seen = np.isfinite(own)
    if not seen.any():
        return {"p50": float("nan"), "p90": float("nan"), "max": float("nan")}
    p50, p90 = np.quantile(own[seen], [0.5, 0.9])
    worst = int(np.argmax(np.where(seen, own, -1.0)))
    run = data.runs[data.run[worst]]
    begin = float(data.start[worst] - run.t[0])
    return {"p50": float(p50), "p90": float(p90), "max": float(own[worst]), "run": run.name, "from": begin}
