"""What is kept back: whole windows, of every kind, and exactly what the user names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales, per_window
from residual_mpc.diagnosis.data.hold_out import KeptBack, choose_held_out, held_out_mask
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.errors import BadInput
from residual_mpc.models.settings import Settings

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
FAULTS = {"track_width": {"scale": 1.2}}


def dataset(*seconds: float) -> Dataset:
    runs = [rover_run(f"run{i}", FAULTS, s, seed=i) for i, s in enumerate(seconds)]
    return build_dataset(runs, [ROVER] * len(runs), SIGMA)


def errors_of(data: Dataset) -> np.ndarray:
    return per_window(data, measure_scales(data), data.y - predict(data, Settings(1))[0])


@pytest.mark.parametrize("seconds", [(24.0,), (40.0, 12.0), (9.5, 9.5, 9.5), (4.0,)])
def test_stretches_are_whole_windows_and_about_a_quarter(seconds: tuple[float, ...]) -> None:
    data = dataset(*seconds)
    kept = choose_held_out(data, errors_of(data))
    mask = held_out_mask(data, kept)
    assert 0.12 <= mask.mean() <= 0.4
    for k in kept:
        assert k.start is not None and k.end is not None
        mine = data.run == [r.name for r in data.runs].index(k.run)
        assert np.isclose(data.start[mine], k.start).any()  # begins where a window does
        assert (k.end - k.start) / data.horizon == pytest.approx(round((k.end - k.start) / data.horizon))
    inside = sum(round((k.end - k.start) / data.horizon) for k in kept if k.start is not None and k.end is not None)
    assert inside == mask.sum()
    assert set(data.run[mask]) == set(range(len(seconds)))  # some of every run


def test_of_many_runs_whole_ones_are_kept_back() -> None:
    data = dataset(*[5.0] * 8)
    nominal = errors_of(data)
    kept = choose_held_out(data, nominal)
    assert len(kept) == 2 and all(k.start is None for k in kept)
    size = np.array([nominal[data.run == i].mean() for i in range(8)])
    ranks = sorted(np.argsort(np.argsort(size))[[int(k.run[3:]) for k in kept]])
    assert ranks[0] < 4 <= ranks[1]  # from both halves of the nominal error
    mask = held_out_mask(data, kept)
    assert all(mask[data.run == i].all() or not mask[data.run == i].any() for i in range(8))


@pytest.mark.parametrize("others", [5, 8])
@pytest.mark.parametrize("columns", ["velocity.left", "enabled.left"])
def test_a_run_that_alone_can_tell_something_is_never_kept_back_whole(others: int, columns: str) -> None:
    runs = [rover_run(f"run{i}", FAULTS, 12.0, seed=i) for i in range(others + 1)]
    last = runs[-1]
    told = np.where(last.t < 6.0, 0.0, last.columns["command.left"] if columns == "velocity.left" else 1.0)
    runs[-1] = replace(last, columns={**last.columns, columns: told})
    data = build_dataset(runs, [ROVER] * len(runs), SIGMA)
    kept = choose_held_out(data, errors_of(data))
    mine = [k for k in kept if k.run == last.name]
    assert mine and all(k.start is not None for k in mine)
    assert any(k.start is None for k in kept) == (others >= 6)


def test_too_few_windows_keep_nothing_back() -> None:
    data = dataset(3.0)
    assert choose_held_out(data, errors_of(data)) == ()


def test_the_choice_needs_no_dice() -> None:
    data = dataset(24.0)
    assert choose_held_out(data, errors_of(data)) == choose_held_out(data, errors_of(data))


def test_exactly_what_is_named() -> None:
    data = dataset(6.0, 6.0)
    mask = held_out_mask(data, [KeptBack("run1")])
    np.testing.assert_array_equal(mask, data.run == 1)
    part = held_out_mask(data, [KeptBack("run0", 2.0, 4.0)])
    np.testing.assert_array_equal(part, (data.run == 0) & np.isin(data.start, [2.0, 3.0]))
    inexact = held_out_mask(data, [KeptBack("run0", 1.5, 4.2)])  # whole windows alone
    np.testing.assert_array_equal(inexact, part)


@pytest.mark.parametrize(
    "kept",
    [[KeptBack("run7")], [KeptBack("run0"), KeptBack("run1")], [KeptBack("run0", 2.2, 2.9)]],
)
def test_what_cannot_be_kept_back_is_refused(kept: list[KeptBack]) -> None:
    with pytest.raises(BadInput, match="`held_out`"):
        held_out_mask(dataset(6.0, 6.0), kept)


def test_as_the_document_has_it() -> None:
    assert KeptBack("run1").document() == "run1"
    assert KeptBack("run1", 2.0, 4.0).document() == {"run": "run1", "from": 2.0, "to": 4.0}
