"""Runs as they were read, mended where the log itself shows how."""

from __future__ import annotations

from collections.abc import Sequence

from residual_mpc.logs.bursts import without_bursts
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.lost_rows import with_lost_rows
from residual_mpc.logs.run import Run
from residual_mpc.logs.sampling_times import with_sampling_times
from residual_mpc.logs.speeds_of_angles import with_speeds_of_angles


def mended(runs: Sequence[Run], channels: Sequence[Sequence[str]]) -> tuple[tuple[Run, ...], tuple[Finding, ...]]:
    """The runs at the times at which their samples were taken, with the rows that were lost, and with the speeds of
    angles that the model does not predict; and what was done.

    Args:
        channels: of each run, those that its model predicts.
    """
    single, bursts = without_bursts(runs)
    dated, stamped = with_sampling_times(single)
    whole, lost = with_lost_rows(dated)
    moving, angles = with_speeds_of_angles(whole, channels)
    return moving, (*bursts, *stamped, *lost, *angles)
