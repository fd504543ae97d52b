"""Sensor noise from what a model leaves: its size and colour on perfect robots, and no more than that on others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import gap_of, measure_scales
from residual_mpc.diagnosis.data.noise_model import ChannelNoise, ornstein_uhlenbeck
from residual_mpc.diagnosis.fit.noise_fit import fit_noise, no_more_than_left, stated_sizes
from residual_mpc.diagnosis.fit.settings import FitSettings
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.noise_errors import noise_errors
from residual_mpc.diagnosis.predict.problem import build_problem
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", 0.033, 0.16)
RUNS = 3
TIME = 0.3  # s: correlation time of the coloured noise, which is autoregressive at the log's 20 Hz with rho 0.85


def wandering(run: Run, sigma: dict[str, float], rho: float, seed: int) -> Run:
    """The run with first-order autoregressive noise of stationary 1-sigma `sigma` on its pose, by the recursion."""
    rng = np.random.default_rng(seed)
    columns = dict(run.columns)
    for channel, size in sigma.items():
        n = np.empty(len(run.t))
        n[0] = size * rng.standard_normal()
        for k in range(1, len(n)):
            n[k] = rho * n[k - 1] + size * np.sqrt(1.0 - rho**2) * rng.standard_normal()
        columns[channel] = columns[channel] + n
    return replace(run, columns=columns)


def rounded(run: Run, steps: dict[str, float]) -> Run:
    """The run with its pose logged in steps."""
    return replace(run, columns=run.columns | {c: np.round(run.columns[c] / step) * step for c, step in steps.items()})


def data_of(
    faults: dict[str, dict[str, float]],
    sigma: dict[str, float],
    white: float,
    horizon: float,
    steps: dict[str, float] | None = None,
) -> Dataset:
    rho = float(np.exp(-0.05 / TIME))
    runs = [wandering(rover_run(f"r{k}", faults, 30.0, seed=k, noise=white), sigma, rho, 50 + k) for k in range(RUNS)]
    return build_dataset([rounded(run, steps or {}) for run in runs], [ROVER] * RUNS, {}, horizon)


def fitted(data: Dataset) -> tuple[ChannelNoise, ...]:
    problem = build_problem(data, build_space(data, ()), data.sigma)
    return fit_noise(problem, measure_scales(data), predict(data, Settings(1))[0], settings=FitSettings())


def times_floor(data: Dataset) -> np.ndarray:
    """(C,) gap of the nominal model over the floor of the noise that it leaves."""
    scales, seen = measure_scales(data), replace(data, noise=fitted(data))
    drawn = noise_errors(seen, Settings(1), np.random.default_rng(0), 8)
    floor = np.sqrt(np.mean([gap_of(seen, scales, e).channels ** 2 for e in drawn], axis=0))
    return np.asarray(gap_of(seen, scales, seen.y - predict(seen, Settings(1))[0]).channels / floor)


def test_coloured_noise_of_a_perfect_rover_is_found_in_size() -> None:
    sigma = {c: 6.0 * s for c, s in SIGMA.items()}
    data = data_of({}, sigma, 0.2, 5.0)
    for channel, noise in zip(data.channels, fitted(data), strict=True):
        assert noise.sigma == pytest.approx(sigma[channel], rel=0.3)
        assert sum(s * s for s, _ in noise.coloured) > 0.7 * noise.sigma**2


@pytest.mark.parametrize("horizon", [1.0, pytest.param(5.0, marks=pytest.mark.slow)])
def test_the_floor_of_a_perfect_rover_with_coloured_noise_is_its_gap(horizon: float) -> None:
    assert times_floor(data_of({}, {c: 6.0 * s for c, s in SIGMA.items()}, 0.2, horizon)) == pytest.approx(
        np.ones(3), abs=0.25
    )


@pytest.mark.parametrize("horizon", [1.0, pytest.param(5.0, marks=pytest.mark.slow)])
def test_so_is_that_of_one_whose_pose_is_rounded_to_steps_of_its_noise(horizon: float) -> None:
    sigma = {c: 3.0 * s for c, s in SIGMA.items()}
    assert times_floor(data_of({}, sigma, 0.2, horizon, sigma)) == pytest.approx(np.ones(3), abs=0.25)


@pytest.mark.parametrize(
    "faults",
    [
        {"wheel_radius_mismatch": {"ratio": 1.08}},
        pytest.param({"track_width": {"scale": 1.15}}, marks=pytest.mark.slow),
    ],
)
def test_an_effect_does_not_hide_in_a_rounded_pose(faults: dict[str, dict[str, float]]) -> None:
    assert times_floor(data_of(faults, {}, 0.5, 5.0, {c: 3.0 * s for c, s in SIGMA.items()})).max() > 3.0


def test_white_noise_stays_white() -> None:
    data = data_of({}, {}, 2.0, 5.0)
    for channel, noise in zip(data.channels, fitted(data), strict=True):
        assert noise.white == pytest.approx(2.0 * SIGMA[channel], rel=0.15)
        assert noise.sigma == pytest.approx(2.0 * SIGMA[channel], rel=0.15)


@pytest.mark.parametrize(
    "faults",
    [
        {"wheel_radius_mismatch": {"ratio": 1.08}},
        pytest.param({"track_width": {"scale": 1.15}}, marks=pytest.mark.slow),
        pytest.param({"voltage_sag": {"rate": 0.02}}, marks=pytest.mark.slow),
    ],
)
def test_what_a_model_does_wrong_is_not_taken_for_noise(faults: dict[str, dict[str, float]]) -> None:
    assert times_floor(data_of(faults, {}, 1.0, 5.0)).max() > 3.0


def test_an_effect_does_not_hide_in_coloured_noise() -> None:
    sigma = {c: 4.0 * s for c, s in SIGMA.items()}
    assert times_floor(data_of({"track_width": {"scale": 1.15}}, sigma, 0.2, 5.0)).max() > 3.0


def test_what_the_user_states_stands() -> None:
    runs = [rover_run("r0", {})]
    data = build_dataset(runs, [ROVER], {"pose.x": 0.01})
    noise = stated_sizes(data, tuple(ChannelNoise(0.001, ((0.002, 0.3),)) for _ in data.channels))
    sizes = {c: n.sigma for c, n in zip(data.channels, noise, strict=True)}
    assert sizes["pose.x"] == pytest.approx(0.01)
    assert sizes["pose.y"] == pytest.approx(np.hypot(0.001, 0.002))


def test_no_noise_makes_more_than_is_left() -> None:
    data = data_of({}, {}, 1.0, 1.0)
    much = tuple(ChannelNoise(50.0 * SIGMA[c]) for c in data.channels)
    less = no_more_than_left(much, data, measure_scales(data), Settings(1), settings=FitSettings())
    for channel, noise in zip(data.channels, less, strict=True):
        assert noise.sigma < 3.0 * SIGMA[channel]


def test_a_channel_that_stands_still_says_nothing_of_its_noise() -> None:
    """Six of seven runs hold the heading's last count; the noise is that of the run in which it moves."""
    runs = [rover_run(f"r{k}", {}, seed=k) for k in range(7)]
    frozen = [replace(r, columns={**r.columns, "pose.theta": np.full(len(r.t), 0.3)}) for r in runs[1:]]
    data = build_dataset([runs[0], *frozen], [ROVER] * 7, {})
    assert data.sigma[data.channels.index("pose.theta")] == pytest.approx(SIGMA["pose.theta"], rel=0.25)


def test_a_channel_that_never_moves_does_not_count_as_free_of_noise() -> None:
    runs = [rover_run(f"r{k}", {}, seed=k) for k in range(2)]
    frozen = [replace(r, columns={**r.columns, "pose.theta": np.full(len(r.t), 0.3)}) for r in runs]
    data = build_dataset(frozen, [ROVER] * 2, {})
    assert data.sigma[data.channels.index("pose.theta")] >= 0.5 * SIGMA["pose.x"]


def test_the_recursion_is_the_process() -> None:
    """Ornstein-Uhlenbeck noise of unit variance: exp(-lag / time) is its correlation."""
    t = 0.05 * np.arange(400)
    x = ornstein_uhlenbeck(t, 0.3, 4000, np.random.default_rng(0))
    assert x.std() == pytest.approx(1.0, abs=0.02)
    for lag in (1, 6, 20):
        assert np.mean(x[:, lag:] * x[:, :-lag]) == pytest.approx(np.exp(-0.05 * lag / 0.3), abs=0.03)


def test_impossible_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="correlation times"):
        ChannelNoise(0.1, ((0.1, 0.0),))
