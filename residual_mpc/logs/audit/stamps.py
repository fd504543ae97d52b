"""Rate, jitter and gaps of the time stamps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run
from residual_mpc.logs.time_gaps import rows_before_gaps

JITTER = 0.5  # of the median period, from the 5th to the 95th percentile
SLOW = 0.25  # s between samples: a window of a second then holds fewer than four


def check_stamps(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """Gaps, jitter and slow rates of each run, and rates that differ between the runs."""
    findings: list[Finding] = []
    for run in runs:
        findings += _gaps(run)
    uneven = [run.name for run in runs if _jitter(run) > JITTER]
    if uneven:
        worst = max(runs, key=_jitter)
        findings.append(
            Finding(
                "info",
                "jitter",
                uneven[0] if len(uneven) == 1 else "",
                "t",
                None,
                f"in {len(uneven)} of {len(runs)} runs the sampling period varies by more than {JITTER:.0%}"
                f" of its median (by {_jitter(worst):.0%} in {worst.name}); the time stamps are used as they are",
            )
        )
    periods = np.array([run.period for run in runs])
    if periods.max() > 1.5 * periods.min():
        findings.append(
            Finding(
                "info",
                "rates differ",
                "",
                "t",
                None,
                f"sampling rates of the runs range from {1.0 / periods.max():.3g} to {1.0 / periods.min():.3g} Hz",
            )
        )
    if periods.max() > SLOW:
        slowest = runs[int(periods.argmax())]
        findings.append(
            Finding(
                "warning",
                "slow rate",
                slowest.name,
                "t",
                None,
                f"samples are {slowest.period:.3g} s apart; faster dynamics cannot be observed",
                "log at a higher rate, or check that 't' is in seconds",
            )
        )
    return findings


def _gaps(run: Run) -> list[Finding]:
    step, wide = np.diff(run.t), rows_before_gaps(run)
    if not wide.size:
        return []
    k = int(wide[0])
    more = f", and {wide.size - 1} more {'gap' if wide.size == 2 else 'gaps'}" if wide.size > 1 else ""
    return [
        Finding(
            "warning",
            "gap in time",
            run.name,
            "t",
            k,
            f"no samples for {step[k]:.3g} s from t = {run.t[k]:.6g} s{more} ({step[wide].sum():.3g} s in total)",
            "nothing to do: `diagnose`, `compare` and `learn` leave out the windows across it; `gap` counts them, with "
            "the last command held",
        )
    ]


def _jitter(run: Run) -> float:
    low, high = np.quantile(np.diff(run.sampled), [0.05, 0.95])
    return float(high - low) / run.period
