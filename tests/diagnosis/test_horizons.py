"""Several horizons: which, on which windows, and effects that only the longer ones show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset, joined
from residual_mpc.diagnosis.data.gap import Gap, gap_of, measure_scales
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.horizons import worth_searching
from residual_mpc.diagnosis.predict.horizons import foretold, longer_horizons, windows_between, windows_over
from residual_mpc.diagnosis.predict.noise_floor import NoiseFloor
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.predict.settings import PredictSettings
from residual_mpc.diagnosis.results.records import Diagnosis
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", 0.033, 0.16)
KNOWN = np.zeros(3, dtype=bool)


def diagnosed(runs: list[Run]) -> Diagnosis:
    return diagnose(runs, [ROVER] * len(runs), {}, (), Options(), np.random.default_rng(0)).diagnosis


@pytest.mark.parametrize(
    ("seconds", "wanted"), [(2.0, ()), (12.0, (5.0, 10.0)), (20.0, (5.0, 20.0)), (70.0, (5.0, 30.0))]
)
def test_five_seconds_and_the_longest_up_to_thirty(seconds: float, wanted: tuple[float, ...]) -> None:
    run = Run("r", np.arange(0.0, seconds + 0.05, 0.1), {})
    assert longer_horizons([run] * 3, 1.0, settings=PredictSettings()) == wanted


@pytest.mark.slow
def test_windows_for_fits_lie_outside_what_is_kept_back() -> None:
    runs = [rover_run(f"r{k}", {}, 30.0, seed=k) for k in range(3)]
    kept = (KeptBack("r0", 10.0, 15.0), KeptBack("r1"), KeptBack("r2", 0.0, 5.0))
    look = windows_over(runs, [ROVER] * 3, {}, 5.0, 1.0, kept, {}, KNOWN[: len(runs)], settings=PredictSettings())
    assert look is not None and look.free is not None
    free = look.free[0]
    for name, start in zip((runs[i].name for i in free.run), free.start, strict=True):
        assert name != "r1"
        for k in kept:
            if k.run == name and k.start is not None and k.end is not None:
                assert start + free.horizon <= k.start + 1e-6 or start >= k.end - 1e-6
    held = {(runs[i].name, float(s)) for i, s in zip(look.raw.run[look.held], look.raw.start[look.held], strict=True)}
    assert held == {("r0", 10.0), ("r2", 0.0)} | {("r1", 5.0 * k) for k in range(6)}


def test_short_runs_have_no_windows_of_a_longer_horizon() -> None:
    runs = [rover_run("long", {}, 20.0), rover_run("short", {}, 3.0, seed=1)]
    look = windows_over(runs, [ROVER] * 2, {}, 5.0, 1.0, (), {}, KNOWN[: len(runs)], settings=PredictSettings())
    assert look is not None
    assert {runs[i].name for i in look.raw.run} == {"long"}


def test_joined_windows_are_those_of_each_horizon() -> None:
    """Prediction and gap of a joined dataset are those of its parts."""
    runs = [rover_run(f"r{k}", {"track_width": {"scale": 1.2}}, seed=k) for k in range(2)]
    parts = [build_dataset(runs, [ROVER] * 2, SIGMA, h) for h in (1.0, 5.0)]
    both = joined(parts)
    predicted = predict(both, Settings(1))[0]
    first = 0
    for part in parts:
        rows = slice(first, first + part.count)
        first += part.count
        alone = predict(part, Settings(1))[0]
        np.testing.assert_array_equal(predicted[rows, : alone.shape[1]], alone)
        scales = measure_scales(part)
        some = np.zeros(both.count, dtype=bool)
        some[rows] = True
        error = np.where(some[:, None, None], both.y - predicted, np.nan)
        assert gap_of(both, scales, error, some).total == pytest.approx(gap_of(part, scales, part.y - alone).total)


def test_a_model_that_diverges_is_not_foretold() -> None:
    runs = [rover_run(f"r{k}", {}, seed=k) for k in range(3)]
    jumps = [np.random.default_rng(k).normal(0.0, 2.0, len(r.t)) for k, r in enumerate(runs)]
    noisy = [
        replace(r, columns={**r.columns, "pose.theta": r.columns["pose.theta"] + jump})
        for r, jump in zip(runs, jumps, strict=True)
    ]
    look = windows_over(noisy, [ROVER] * 3, {}, 5.0, 1.0, (), {}, KNOWN[: len(runs)], settings=PredictSettings())
    assert look is None or not foretold(look.clean, look.scales, np.random.default_rng(0), settings=PredictSettings())
    clear = windows_over(runs, [ROVER] * 3, {}, 5.0, 1.0, (), {}, KNOWN[: len(runs)], settings=PredictSettings())
    assert clear is not None and foretold(
        clear.clean, clear.scales, np.random.default_rng(0), settings=PredictSettings()
    )


@pytest.mark.parametrize(("left", "searched"), [(0.4, True), (0.99, True), (1.0, False), (7.0, False)])
def test_windows_whose_prediction_is_lost_are_not_searched(left: float, searched: bool) -> None:
    """Where what was found leaves more than the motion itself, other effects only fit how errors grow."""
    runs = [rover_run(f"r{k}", {}, 60.0, seed=k) for k in range(2)]
    data = build_dataset(runs, [ROVER] * 2, SIGMA, horizon=5.0)
    channels = np.full(3, left)
    gap, floor = Gap(left, channels), NoiseFloor(0.02, np.full(3, 0.02), 0.02, np.full(3, 0.02), 20)
    assert worth_searching(data, gap, floor, Options()) is searched


def test_shorter_windows_fill_what_is_not_held_out() -> None:
    """If errors grow fast, the fits use windows of a quarter of a second, none of which overlaps a held-out span."""
    runs = [rover_run(f"r{k}", {}, seed=k) for k in range(2)]
    kept = [KeptBack("r0", 2.0, 5.0)]
    near = windows_between(runs, [ROVER] * 2, SIGMA, 0.25, kept, {}, KNOWN[: len(runs)], settings=PredictSettings())
    assert near is not None
    data, _ = near
    mine = data.start[data.run == 0]
    assert data.horizon == 0.25 and not ((mine + 0.25 > 2.0 + 1e-6) & (mine < 5.0 - 1e-6)).any()
    seconds = [r.t[-1] - r.t[0] for r in runs]
    assert data.count == pytest.approx((sum(seconds) - 3.0) / 0.25, abs=3)


def test_wheels_that_differ_by_two_percent_are_found_without_an_option() -> None:
    """Within one second the noise of this localisation hides them (finding 6 of the outside checks)."""
    runs = [rover_run(f"r{k}", {"wheel_radius_mismatch": {"ratio": 1.02}}, 35.0, seed=k, noise=4.0) for k in range(3)]
    found = diagnosed(runs)
    assert found.verdict == "effects"
    named = {c.term.effect for c in found.causes} | {t.effect for g in found.groups for m in g for t in m}
    assert "wheel_radius_mismatch" in named
    assert [h.horizon for h in found.gap.horizons] == [1.0, 5.0, 30.0]
    longest = found.gap.horizons[-1]
    assert longest.after < longest.before and longest.after < 2.0 * longest.noise_floor


@pytest.mark.slow
def test_a_short_log_is_searched_over_longer_windows_as_well() -> None:
    """Six windows of 5 s are enough to look: what is found there still has to pass the tests for an addition."""
    runs = [rover_run(f"r{k}", {"wheel_radius": {"scale": 0.97}}, 17.0, seed=k, noise=5.0) for k in range(3)]
    found = diagnosed(runs)
    named = {c.term.effect for c in found.causes} | {t.effect for g in found.groups for m in g for t in m}
    assert found.verdict == "effects" and "wheel_radius" in named


def test_a_rover_that_starts_from_rest_is_seen_to() -> None:
    """Without encoders the pose says whether the wheels stood still before the first stamp; else a lag's memory begins
    at the first command (contract, section 4)."""
    t = np.arange(0.0, 10.0, 0.05)
    tau, u = 0.3, 4.0
    # from rest, the exact answer of a first-order lag to a step at 0
    x = 0.033 * u * (t - tau * (1.0 - np.exp(-t / tau)))
    columns = {"command.left": np.full(len(t), u), "command.right": np.full(len(t), u), "pose.x": x,
               "pose.y": np.zeros(len(t)), "pose.theta": np.zeros(len(t))}  # fmt: skip
    data = build_dataset([Run("r", t, columns)], [ROVER], SIGMA, 5.0)
    drive = data.blocks[0].drive
    assert (drive.command[0, : drive.lead - 1] == 0.0).all()
    moving = {**columns, "pose.x": 0.033 * u * t}
    drive = build_dataset([Run("r", t, moving)], [ROVER], SIGMA, 5.0).blocks[0].drive
    assert (drive.command[0, : drive.lead - 1] == u).all()
