"""What belongs to a sample stays with it in every window, and repeats of a sensor are no new readings there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.window_samples import fresh_in_windows, in_windows

ROVER = DiffDrive("rover", 0.033, 0.16)


def test_samples_keep_their_values() -> None:
    runs = [rover_run(f"r{k}", {}, 6.0, seed=k) for k in range(2)]
    holes = {name: y.copy() for name, y in runs[1].columns.items()}
    holes["pose.x"][40:60] = np.nan
    data = build_dataset([runs[0], replace(runs[1], columns=holes)], [ROVER] * 2, {})
    np.testing.assert_array_equal(in_windows(data, {key: s.y for key, s in data.signals.items()}), data.y)


def test_repeats_are_not_fresh() -> None:
    run = rover_run("r", {}, 12.0, seed=3)
    y, missed = run.columns["pose.x"].copy(), np.random.default_rng(0).uniform(size=len(run.t)) < 0.12
    for k in 1 + np.flatnonzero(missed[1:]):
        y[k] = y[k - 1]
    data = build_dataset([replace(run, columns={**run.columns, "pose.x": y})], [ROVER], {})
    fresh, k = fresh_in_windows(data), data.channels.index("pose.x")
    assert 0.05 < 1.0 - fresh[..., k][np.isfinite(data.y[..., k])].mean() < 0.13
    others = [c for c in range(len(data.channels)) if c != k]
    np.testing.assert_array_equal(fresh[..., others], np.isfinite(data.y[..., others]))
