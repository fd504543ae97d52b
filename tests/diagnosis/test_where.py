"""Where the gap lies: errors that are put into one channel, motion or moment are found there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis.linear import ROVER
from oracles.rover_log import SIGMA

from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import Scales, measure_scales
from residual_mpc.diagnosis.data.settings import DataSettings
from residual_mpc.diagnosis.data.where import locate, regime_masks
from residual_mpc.logs.run import Run

# (until s, left rad/s, right rad/s): standing, creeping, straight on fast, turning left, turning right, backwards
STAGES = ((4, 0.0, 0.0), (8, 1.0, 1.0), (12, 9.0, 9.0), (16, 2.0, 6.0), (20, 6.0, 2.0), (24, -9.0, -9.0))
PERIOD = 0.05  # s


def command(t: np.ndarray, wheel: int) -> np.ndarray:
    stage = np.searchsorted([until for until, *_ in STAGES], t, side="right").clip(max=len(STAGES) - 1)
    return np.array([s[1 + wheel] for s in STAGES])[stage]


def data_of(names: tuple[str, ...] = ("one",), enabled: np.ndarray | None = None) -> Dataset:
    t = PERIOD * np.arange(round(STAGES[-1][0] / PERIOD) + 1)
    columns = {f"command.{w}": command(t, i) for i, w in enumerate(("left", "right"))}
    columns |= {c: np.cumsum(np.random.default_rng(0).standard_normal(len(t))) for c in SIGMA}
    if enabled is not None:
        columns["enabled.left"] = np.where((t >= enabled[0]) & (t < enabled[1]), 0.0, 1.0)
    return build_dataset([Run(n, t, columns) for n in names], [ROVER] * len(names), SIGMA)


def growing(data: Dataset, begin: float, end: float) -> np.ndarray:
    """An error (W, M, C) that grows by one at every sample between two times of the log, and stays."""
    at = data.t + data.start[:, None]
    step = ((at >= begin + 0.3) & (at < end - 1e-6) & (data.t > 0.0)).astype(float)  # what a jump leaves is over
    return np.repeat(np.cumsum(step, axis=1)[..., None], len(data.channels), axis=2)


DATA = data_of()
SCALES = measure_scales(DATA)


@pytest.mark.parametrize("channel", sorted(SIGMA))
def test_an_error_of_one_channel_is_all_of_the_gap(channel: str) -> None:
    error = np.zeros_like(DATA.y)
    error[..., DATA.channels.index(channel)] = 0.1
    shares = dict(locate(DATA, SCALES, error).channels)
    assert shares[channel] == pytest.approx(1.0) and sum(shares.values()) == pytest.approx(1.0)


def test_channels_share_the_square_of_what_each_misses_of_its_own_motion() -> None:
    error = np.ones_like(DATA.y) * SCALES.s * [0.1, 0.2, 0.4]
    found = locate(DATA, SCALES, error).channels
    assert [c for c, _ in found] == list(DATA.channels)[::-1]  # the largest first
    assert [s for _, s in found] == pytest.approx([16 / 21, 4 / 21, 1 / 21])


def test_a_channel_that_stands_still_has_no_share() -> None:
    still = Scales(SCALES.s, np.array([True, False, False]), SCALES.compared)
    found = locate(DATA, still, np.ones_like(DATA.y) * SCALES.s)
    assert dict(found.channels) == pytest.approx(dict.fromkeys(DATA.channels[1:], 0.5))


@pytest.mark.parametrize(
    ("name", "begin", "end"),
    [("standstill", 0, 4), ("slow", 4, 8), ("turning left", 12, 16), ("turning right", 16, 20)],
)
def test_an_error_that_grows_in_one_regime_is_found_there(name: str, begin: float, end: float) -> None:
    found = {r.name: r for r in locate(DATA, SCALES, growing(DATA, begin, end)).regimes}
    assert found[name].share == pytest.approx(1.0, abs=1e-3)
    assert found[name].lift == pytest.approx(6.0, rel=0.05)  # a sixth of the time holds all of it
    others = {"standstill", "slow", "fast", "turning left", "turning right"} - {name}
    assert all(found[n].share < 0.01 for n in others)


def test_fast_is_fast_in_either_direction() -> None:
    error = growing(DATA, 8, 12) + growing(DATA, 20, 24)
    fast = next(r for r in locate(DATA, SCALES, error).regimes if r.name == "fast")
    assert fast.share == pytest.approx(1.0, abs=1e-3) and fast.lift == pytest.approx(3.0, rel=0.05)


def test_an_error_that_grows_at_the_same_rate_all_the_time_singles_out_no_regime() -> None:
    error = np.broadcast_to(np.arange(1.0, DATA.y.shape[1] + 1)[:, None], DATA.y.shape)
    assert all(r.lift == pytest.approx(1.0) for r in locate(DATA, SCALES, error).regimes)


def test_regimes_follow_the_commands() -> None:
    """Against the times at which the log changes its commands."""
    masks, at = regime_masks(DATA), DATA.t + DATA.start[:, None]
    seen = np.isfinite(DATA.y).any(axis=2)

    def lies(name: str, *spans: tuple[float, float]) -> bool:
        inside = np.any([(at >= a) & (at < b) for a, b in spans], axis=0)
        edge = np.any([np.abs(at - x) < 0.06 for span in spans for x in span], axis=0)
        return bool((masks[name] == inside)[seen & ~edge].all())

    assert lies("standstill", (0, 4)) and lies("slow", (4, 8)) and lies("fast", (8, 12), (20, 24.1))
    assert lies("turning left", (12, 16)) and lies("turning right", (16, 20))
    assert lies("first third of the run", (0, 8)) and lies("last third of the run", (17, 24.1))  # by windows' starts
    assert lies("command reversal", (20, 20.25))
    assert "actuator off" not in masks


def test_a_motor_that_is_off_is_a_regime() -> None:
    data = data_of(enabled=np.array([9.0, 11.0]))
    at = data.t + data.start[:, None]
    off = regime_masks(data)["actuator off"]
    assert off[(at > 9.06) & (at < 10.94)].all() and not off[(at < 8.94) | (at > 11.06)].any()


def test_the_worst_moments_come_first_with_their_part_of_the_gap() -> None:
    data = data_of(("one", "two"))
    error = np.zeros_like(data.y)
    for (run, start), size in {(0, 7.0): 1.0, (1, 13.0): 2.0}.items():
        error[(data.run == run) & np.isclose(data.start, start)] = size
    times = locate(data, measure_scales(data), error).times
    assert len(times) == DataSettings().where.worst
    assert [(s.run, s.start, s.end) for s in times[:2]] == [("two", 13.0, 14.0), ("one", 7.0, 8.0)]
    assert [s.share for s in times] == pytest.approx([0.8, 0.2, 0.0, 0.0, 0.0, 0.0])


def test_samples_that_are_missing_count_for_nothing() -> None:
    error = growing(DATA, 12, 16)
    y = DATA.y.copy()
    gone = DATA.t + DATA.start[:, None] >= 18.0
    y[gone] = np.nan
    blind = replace(DATA, y=y)
    found = locate(blind, SCALES, np.where(gone[..., None], np.nan, error))
    left = next(r for r in found.regimes if r.name == "turning left")
    assert left.share == pytest.approx(1.0, abs=1e-3)
    assert left.lift == pytest.approx(18.0 / 4.0, rel=0.05)
