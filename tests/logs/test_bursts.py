"""Rows that arrive several at once, though they were taken evenly, are dated evenly; others keep their stamps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from residual_mpc.logs.bursts import without_bursts
from residual_mpc.logs.mended import mended
from residual_mpc.logs.run import Run

RATE, COUNT = 50.0, 600


def even(seed: int = 0) -> Run:
    t = np.arange(COUNT) / RATE
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(COUNT)
    return Run("r", t, {"command.j": np.sin(t), "position.j": np.sin(2.0 * t) + noise})


def in_bursts(run: Run, sizes: list[int], jitter: float = 0.0, seed: int = 1) -> Run:
    """Each burst arrives with its last row, up to `jitter` s late."""
    rng, t, first, k = np.random.default_rng(seed), run.t.copy(), 0, 0
    while first < COUNT:
        size = sizes[k % len(sizes)]
        last = min(first + size, COUNT) - 1
        t[first : last + 1] = run.t[last] + rng.uniform(0.0, jitter) - 4e-4 * np.arange(last - first, -1, -1)
        first, k = last + 1, k + 1
    return replace(run, t=t - t[0])


@pytest.mark.parametrize(("sizes", "jitter"), [([4], 0.0), ([4], 4e-3), ([3, 5, 4], 2e-3), ([8], 0.0)])
def test_bursts_are_dated_evenly(sizes: list[int], jitter: float) -> None:
    run = even()
    (got,), (finding,) = without_bursts([in_bursts(run, sizes, jitter)])
    off = got.t - run.t
    assert np.abs(off - off.mean()).max() < 0.1 / RATE  # stamps were off by up to seven periods
    assert -(max(sizes) - 1) / RATE - jitter <= got.start - 0.0 <= jitter  # the first row of a burst came before it
    assert finding.severity == "warning" and finding.column == "t"


def test_a_pause_stays() -> None:
    run = even()
    run = replace(run, t=run.t + np.where(np.arange(COUNT) >= 300, 1.0, 0.0))
    (got,), _ = without_bursts([in_bursts(run, [4])])
    off = got.t - run.t
    assert np.abs(off - off.mean()).max() < 0.1 / RATE


@pytest.mark.parametrize("pauses", [[300], [100, 200, 300, 400, 500]])
@pytest.mark.parametrize("pause", [15.0, 100.0])
def test_an_even_log_with_long_pauses_keeps_its_stamps(pauses: list[int], pause: float) -> None:
    """The robot stands still over them, so that the motion goes on where it was."""
    run = even()
    run = replace(run, t=run.t + pause * (np.arange(COUNT)[:, None] >= pauses).sum(axis=1))
    assert without_bursts([run]) == ((run,), ())


def test_what_was_taken_in_bursts_or_evenly_keeps_its_stamps() -> None:
    run = even()
    together = in_bursts(run, [4])
    seen = {"command.j": run.columns["command.j"], "position.j": np.sin(2.0 * together.t)}
    for other in (run, replace(together, columns=seen)):
        assert without_bursts([other]) == ((other,), ())


def test_rows_of_several_topics_keep_their_stamps() -> None:
    """Each row of one topic lies close to one of another."""
    t = np.sort(np.concatenate([np.arange(300) / RATE, np.arange(300) / RATE + 1e-4, np.arange(300) / RATE + 2e-4]))
    columns = {
        "command.j": np.where(np.arange(900) % 3 == 0, np.sin(t), np.nan),
        "position.j": np.where(np.arange(900) % 3 == 1, np.sin(2.0 * t), np.nan),
        "velocity.j": np.where(np.arange(900) % 3 == 2, np.cos(2.0 * t), np.nan),
    }
    run = Run("r", t, columns)
    (got,), findings = mended([run], [("position.j", "velocity.j")])
    assert got is run and findings == ()
