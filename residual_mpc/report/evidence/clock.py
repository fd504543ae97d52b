"""Times as a reader counts them: from each run's first stamp, whatever the clock of the log."""

import numpy as np

from residual_mpc.report.evidence.evidence import Array, Evidence

FAR = 1e3  # times its span, beyond which a coordinate's own offset is taken out of its axis


def first_stamp(evidence: Evidence, run: str) -> float:
    """s; of a run that the evidence does not know, 0."""
    if run in evidence.starts:
        return float(evidence.starts[run])
    mine = np.asarray(evidence.windows.run, dtype=str) == run
    return float(evidence.windows.start[mine].min()) if mine.any() else 0.0


def since_start(evidence: Evidence, run: str, t: float) -> float:
    """s from the run's first stamp."""
    return float(t) - first_stamp(evidence, run)


def offset_of(x: Array) -> float:
    """What to take off an axis so that its labels stay short: 0 for most, the first value of stamps since 1970."""
    seen = x[np.isfinite(x)]
    span = float(np.ptp(seen)) if seen.size else 0.0
    return float(np.floor(seen.min())) if span > 0.0 and np.abs(seen).max() > FAR * span else 0.0
