"""Logs with gaps and incidents: windows across them judge no model, and fits see none of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.rover_log import ROBOT, SIGMA, rover_run, write_run

import residual_mpc as rm
from plants.diff_drive import DiffDrive
from residual_mpc.comparison.sets import cut
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset, window_starts
from residual_mpc.diagnosis.data.hold_out import KeptBack, held_out_mask
from residual_mpc.diagnosis.data.left_out import clear_of, gap_spans, unfit, unfit_spans, untold, without, without_unfit
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.stale import with_stale
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
    assert starts[~clear_of(gap_spans(run), starts, 1.0)].tolist() == pytest.approx([4.0, 5.0, 11.0, 12.0])
    assert [begin for begin, _ in gap_spans(run)] == pytest.approx([4.2, 11.4], abs=run.period)


def test_a_log_without_gaps_loses_nothing_and_one_of_gaps_alone_keeps_all() -> None:
    assert not untold(dataset([rover_run("r", {}, 8.0)])).any()
    everywhere = tuple((k + 0.2, k + 0.8) for k in range(8))
    all_lost = dataset([with_gaps(rover_run("r", {}, 8.0), everywhere)])
    assert untold(all_lost).all() and without(all_lost, untold(all_lost)).count == all_lost.count


def test_what_is_kept_back_is_the_blocks_without_unfit() -> None:
    runs = [*broken(), rover_run("whole", {}, 20.0, seed=9)]
    data = dataset(runs)
    kept = without_unfit(data, (KeptBack("r1"), KeptBack("whole"), KeptBack("r2", 0.0, 3.0), KeptBack("r2", 8.0, 14.0)))
    assert [(k.run, k.start, k.end) for k in kept if k.run == "r1"] == [
        ("r1", 0.0, pytest.approx(4.0)), ("r1", pytest.approx(6.0), pytest.approx(11.0)),
        ("r1", pytest.approx(13.0), pytest.approx(20.0)),
    ]  # fmt: skip
    assert KeptBack("whole") in kept and KeptBack("r2", 0.0, 3.0) in kept
    mask = held_out_mask(data, kept)
    assert not (mask & untold(data)).any()
    assert mask.sum() == 16 + 20 + 3 + (3 + 1)


def test_what_is_kept_back_stays_if_nothing_else_would_be_left() -> None:
    everywhere = with_gaps(rover_run("lost", {}, 8.0), tuple((k + 0.2, k + 0.8) for k in range(8)))
    data = dataset([everywhere, rover_run("whole", {}, 8.0, seed=1)])
    assert without_unfit(data, (KeptBack("lost"),)) == (KeptBack("lost"),)


def test_windows_that_begin_in_a_dropout_are_left_out() -> None:
    """A quadratic through the samples before a dropout is far off within it."""
    run = rover_run("r", {}, 12.0)
    lost = (run.t > 3.9) & (run.t < 5.9)
    columns = {k: np.where(lost, np.nan, v) if k.startswith("pose.") else v for k, v in run.columns.items()}
    data = dataset([replace(run, columns=columns)])
    assert 4.0 in data.start  # its start has samples within 0.25 s, all of them before it
    assert data.start[untold(data)].tolist() == pytest.approx([4.0])


def test_the_gap_of_what_a_diagnosis_kept_back_is_measured_again(tmp_path: Path) -> None:
    """On the same windows, with and without those that nothing is fitted to."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    for run in broken():
        write_run(run, tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, sorted(tmp_path.glob("r*.csv")))
    found = rm.diagnose(robot, runs, only=("track_width",), out=tmp_path / "out")
    again = rm.measure_gap(robot, runs, held_out_of=tmp_path / "out" / "diagnosis.json")
    assert again.nominal == pytest.approx(found.gap["before"], rel=1e-9)
    whole = rm.measure_gap(robot, runs)
    left_out = whole.document["left_out_of_fits"]
    assert left_out["windows"] == 12 and left_out["nominal_without"] < 0.5 * whole.nominal
    assert any("without the 12 windows across gaps or incidents of the log" in line for line in str(whole).split("\n"))


def test_longer_windows_avoid_the_gaps() -> None:
    runs = broken(30.0)
    look = windows_over(
        runs, [ROVER] * 3, {}, 5.0, 1.0, (KeptBack("r0"),), {}, np.zeros(3, dtype=bool), settings=PredictSettings()
    )
    assert look is not None and look.free is not None
    for data in (look.raw, look.free[0]):
        assert data.count
        for i, start in zip(data.run, data.start, strict=True):
            assert clear_of(gap_spans(runs[int(i)]), np.array([start]), data.horizon).all()


def test_comparisons_and_trainings_leave_them_out() -> None:
    runs = broken(count=4)
    sets = cut(runs[:2], runs[2:], [ROVER] * 4, SIGMA, 1.0, DataSettings())
    trained = build_evaluation(runs, [ROVER] * 4, SIGMA, 1.0, Settings(1), False, False)
    for data in (sets.raw, sets.clean, trained.data):
        assert data.count == 4 * 16 and not unfit(data).any()


def test_a_perfect_robot_with_gaps_in_its_logs_has_no_gap() -> None:
    runs = broken()
    found = diagnose(runs, [ROVER] * 3, SIGMA, (), Options(), np.random.default_rng(0)).diagnosis
    assert found.verdict == "no_gap"
    assert any("windows across them are left out" in note for note in found.notes)


def with_incident(run: Run, begin: float, end: float) -> Run:
    return replace(run, incidents=((begin, end),))


def test_no_fit_sees_an_incident_and_the_gap_counts_it() -> None:
    """A localisation jumps by 0.3 m in one run: the cause is found as if it did not, and the jump is not hidden."""
    faults = {"track_width": {"scale": 1.2}}
    runs = [rover_run(f"r{k}", faults, 20.0, seed=k) for k in range(3)]
    jumped = {**runs[1].columns, "pose.x": runs[1].columns["pose.x"] + 0.3 * (runs[1].t > 9.5)}
    runs[1] = with_incident(replace(runs[1], columns=jumped), 9.45, 9.55)
    assert unfit_spans(runs[1]) == [(9.45, pytest.approx(9.85))]
    found = diagnose(runs, [ROVER] * 3, SIGMA, (), Options(), np.random.default_rng(0)).diagnosis
    (cause,) = found.causes
    assert cause.term.effect == "track_width"
    assert cause.parameters[0].value == pytest.approx(1.2, rel=0.01)
    assert all(k.run != "r1" or k.end is None or k.end <= 9.45 + 1e-6 or k.start >= 9.85 - 1e-6 for k in found.held_out)
    assert any("no fit sees windows across them" in note for note in found.notes)


def held_at(run: Run, samples: int) -> Run:
    """The run with a localisation that reports every so many samples, and repeats itself in between."""
    rows = np.arange(len(run.t)) // samples * samples
    return replace(run, columns={k: v[rows] if k.startswith("pose.") else v for k, v in run.columns.items()})


def test_fits_do_not_see_what_a_slow_sensor_repeats() -> None:
    """They would find a delay of half its period."""
    runs = [held_at(rover_run(f"r{k}", {"track_width": {"scale": 1.2}}, 20.0, seed=k), 4) for k in range(3)]
    data = dataset(runs)
    spoilt = with_stale(data, {})
    assert {c for _, c in spoilt} == {"pose.x", "pose.y", "pose.theta"}
    assert np.mean(spoilt[0, "pose.x"]) == pytest.approx(3 / 4, abs=0.03)
    found = diagnose(runs, [ROVER] * 3, SIGMA, (), Options(), np.random.default_rng(0)).diagnosis
    (cause,) = found.causes
    assert cause.term.effect == "track_width"
    low, high = cause.parameters[0].ci95
    assert low < 1.2 < high < 1.25


def test_a_sensor_at_the_rate_of_its_log_repeats_nothing() -> None:
    assert with_stale(dataset([rover_run("r", {}, 10.0)]), {}) == {}


def test_a_gap_that_the_repeats_hide_is_seen_in_the_new_readings() -> None:
    wide, perfect = (
        [held_at(rover_run(f"r{k}", {"track_width": {"scale": scale}}, 20.0, seed=k), 4) for k in range(3)]
        for scale in (1.1, 1.0)
    )
    found = diagnose(wide, [ROVER] * 3, SIGMA, (), Options(), np.random.default_rng(0)).diagnosis
    assert found.gap.before < 1.25 * found.gap.noise_floor
    (cause,) = found.causes
    assert cause.term.effect == "track_width"
    low, high = cause.parameters[0].ci95
    assert low < 1.1 < high
    assert diagnose(perfect, [ROVER] * 3, SIGMA, (), Options(), np.random.default_rng(0)).diagnosis.verdict == "no_gap"


def test_the_new_readings_of_a_slow_sensor_are_judged(tmp_path: Path) -> None:
    """What it repeats counts in the printed gap, as the definition has it, and makes it several times as large."""
    (tmp_path / "robot.toml").write_text(ROBOT)
    faults = {"command_delay": {"delay": 0.12}, "track_width": {"scale": 1.1}}
    for k in range(4):
        write_run(held_at(rover_run(f"r{k}", faults, 20.0, seed=k), 4), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, sorted(tmp_path.glob("r*.csv")))
    found = rm.diagnose(robot, runs, only=tuple(faults), out=tmp_path / "out")
    gap, new = found.gap, found.gap["new_readings"]
    assert found.verdict == "effects"
    assert {e["effect"]: e["probability"] > 0.9 for e in found.explanation} == dict.fromkeys(faults, True)
    usual, repeated = (figures["horizons"][0]["window_gaps"] for figures in (new, gap))
    assert usual["after"]["p50"] < 2.0 * new["noise_floor"] < 0.2 * usual["before"]["p50"]
    assert repeated["after"]["p50"] > 4.0 * usual["after"]["p50"] and gap["noise_floor"] > 4.0 * new["noise_floor"]
    removed = 1.0 - new["after"] / new["before"]
    assert f"removes {100 * removed:.0f}\u00a0% of the gap of the new readings" in found.document["verdict_sentence"]
    assert "gap at 1 s without repeated readings: " in str(found)
    measured = rm.measure_gap(robot, runs, model=found, held_out_of=tmp_path / "out" / "diagnosis.json").document
    assert measured["model"] == pytest.approx(gap["after"], rel=1e-9)
    assert measured["new_readings"]["model"] == pytest.approx(new["after"], rel=1e-9)
    full = rm.read_runs(robot, [write_run(rover_run("full", {}, 8.0), tmp_path)])
    assert rm.measure_gap(robot, full).document["new_readings"] is None
