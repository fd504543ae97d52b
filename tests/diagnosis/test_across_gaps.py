"""Logs with gaps: what was sent in them is unknown, so that windows across them judge no model."""

from __future__ import annotations

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.comparison.sets import cut
from residual_mpc.diagnosis.data.across_gaps import across_gaps, between_gaps, clear_of_gaps, unknown_spans
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset, window_starts
from residual_mpc.diagnosis.data.hold_out import KeptBack, held_out_mask
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.horizons import windows_over
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.learning.batch.evaluation import build_evaluation
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", 0.033, 0.16)
LOST = ((4.2, 5.1), (11.4, 12.2))  # s


def with_gaps(run: Run, spans: tuple[tuple[float, float], ...] = LOST) -> Run:
    keep = np.ones(len(run.t), dtype=bool)
    for begin, end in spans:
        keep &= (run.t <= begin) | (run.t >= end)
    return Run(run.name, run.t[keep], {k: v[keep] for k, v in run.columns.items()})


def broken(seconds: float = 20.0, count: int = 3) -> list[Run]:
    return [with_gaps(rover_run(f"r{k}", {}, seconds, seed=k)) for k in range(count)]


def dataset(runs: list[Run]) -> Dataset:
    return build_dataset(runs, [ROVER] * len(runs), SIGMA)


def test_windows_across_a_gap_and_soon_after_it() -> None:
    run = with_gaps(rover_run("r", {}, 20.0))
    starts = window_starts(run, 1.0)
    assert starts[~clear_of_gaps(run, starts, 1.0)].tolist() == pytest.approx([4.0, 5.0, 11.0, 12.0])
    assert [begin for begin, _ in unknown_spans(run)] == pytest.approx([4.2, 11.4], abs=run.period)


def test_a_log_without_gaps_loses_nothing_and_one_of_gaps_alone_keeps_all() -> None:
    assert not across_gaps(dataset([rover_run("r", {}, 8.0)])).any()
    everywhere = tuple((k + 0.2, k + 0.8) for k in range(8))
    assert not across_gaps(dataset([with_gaps(rover_run("r", {}, 8.0), everywhere)])).any()


def test_what_is_kept_back_is_the_blocks_between_gaps() -> None:
    runs = [*broken(), rover_run("whole", {}, 20.0, seed=9)]
    data = dataset(runs)
    kept = between_gaps(data, (KeptBack("r1"), KeptBack("whole"), KeptBack("r2", 0.0, 3.0), KeptBack("r2", 8.0, 14.0)))
    assert [(k.run, k.start, k.end) for k in kept if k.run == "r1"] == [
        ("r1", 0.0, pytest.approx(4.0)), ("r1", pytest.approx(6.0), pytest.approx(11.0)),
        ("r1", pytest.approx(13.0), pytest.approx(20.0)),
    ]  # fmt: skip
    assert KeptBack("whole") in kept and KeptBack("r2", 0.0, 3.0) in kept
    mask = held_out_mask(data, kept)
    assert not (mask & across_gaps(data)).any()
    assert mask.sum() == 16 + 20 + 3 + (3 + 1)


def test_longer_windows_avoid_the_gaps() -> None:
    runs = broken(30.0)
    look = windows_over(
        runs, [ROVER] * 3, {}, 5.0, 1.0, (KeptBack("r0"),), {}, np.zeros(3, dtype=bool), settings=PredictSettings()
    )
    assert look is not None and look.free is not None
    for data in (look.raw, look.free[0]):
        assert data.count
        for i, start in zip(data.run, data.start, strict=True):
            assert clear_of_gaps(runs[int(i)], np.array([start]), data.horizon).all()


def test_comparisons_and_trainings_leave_them_out() -> None:
    runs = broken(count=4)
    sets = cut(runs[:2], runs[2:], [ROVER] * 4, SIGMA, 1.0, DataSettings())
    trained = build_evaluation(runs, [ROVER] * 4, SIGMA, 1.0, Settings(1), False, False)
    for data in (sets.raw, sets.clean, trained.data):
        assert data.count == 4 * 16 and not across_gaps(data).any()


def test_a_perfect_robot_with_gaps_in_its_logs_has_no_gap() -> None:
    runs = broken()
    found = diagnose(runs, [ROVER] * 3, SIGMA, (), Options(), np.random.default_rng(0)).diagnosis
    assert found.verdict == "no_gap"
    assert any("windows across them are left out" in note for note in found.notes)
