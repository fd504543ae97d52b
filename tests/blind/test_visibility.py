"""How clearly runs show a change, and the sizes that are drawn by it."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_robots import GEOMETRY, rover_log
from scipy import stats

from residual_mpc.api.robot import load_robot
from residual_mpc.blind.recorded.half import Half, Setting
from residual_mpc.blind.recorded.kinds.drive import TRACK
from residual_mpc.blind.recorded.kinds.kind import Kind
from residual_mpc.blind.recorded.recipe import Recipe, draw
from residual_mpc.blind.recorded.sizing import Sized, UntouchedHalves
from residual_mpc.blind.recorded.visibility import WindowErrors, _standard_error, faintest, visibility, window_errors
from residual_mpc.errors import BadInput


def errors(rng: np.random.Generator, runs: int, windows: int = 4, size: float = 1.0) -> WindowErrors:
    """White errors of (runs * windows, 10 parts, 2 channels), half of the runs in the later half."""
    count = runs * windows
    key = np.column_stack([np.repeat(np.arange(runs), windows), np.tile(np.arange(windows), runs)])
    drawn = size * rng.normal(size=(count, 10, 2))
    return WindowErrors(key, key[:, 0] >= runs // 2, key[:, 1].astype(float), drawn, {})


def test_the_visibility_is_that_of_a_z_test_of_the_units():
    """With a constant shift d in n values of deviation 1 per unit, z = d sqrt(n) / sqrt(1/U1 + 1/U2)."""
    rng, shift = np.random.default_rng(0), 0.1
    found = []
    for _ in range(40):
        one = errors(rng, 40)
        found.append(visibility(one, replace(one, errors=one.errors + shift)))
    # units of equal size have a weight of one half each, in the scatter and in the count alike
    assert np.median(found) == pytest.approx(shift * np.sqrt(80.0) / np.sqrt(2.0 / 20.0), rel=0.15)


def test_what_runs_scatter_by_counts_and_what_they_share_does_not():
    rng = np.random.default_rng(1)
    one = errors(rng, 40)
    shared = replace(one, errors=one.errors + 5.0)
    scattered = replace(one, errors=one.errors + rng.normal(size=40)[one.key[:, 0], None, None])
    z = [visibility(e, replace(e, errors=e.errors + 0.1)) for e in (one, shared, scattered)]
    assert z[1] == pytest.approx(z[0], rel=1e-6)
    assert z[2] < 0.3 * z[0]


def test_a_change_that_no_window_shows_has_none():
    one = errors(np.random.default_rng(2), 12)
    assert visibility(one, one) == 0.0


@pytest.mark.parametrize("runs", [12, 40])
def test_four_in_five_of_the_faintest_changes_are_detected_among_forty(runs):
    """By a t test of the units at a level of 2 %, divided by the number of changes that it chooses from."""
    rng = np.random.default_rng(4)
    z = faintest(errors(rng, runs))
    shifted = rng.normal(size=(4000, runs)) + np.where(np.arange(runs) >= runs // 2, z * np.sqrt(4.0 / runs), 0.0)
    p = stats.ttest_ind(shifted[:, runs // 2 :], shifted[:, : runs // 2], axis=1).pvalue
    assert np.mean(p < 0.02 / 40) == pytest.approx(0.8, abs=0.08)


def test_windows_that_a_change_removes_are_left_out():
    one = errors(np.random.default_rng(3), 40)
    fewer = WindowErrors(one.key[1:], one.later[1:], one.start[1:], one.errors[1:] + 0.1, one.noise)
    whole = visibility(one, replace(one, errors=one.errors + 0.1))
    assert visibility(one, fewer) == pytest.approx(whole, rel=0.1)


def test_a_tenth_more_of_a_model_that_turns_four_times_too_far_is_no_more_visible(tmp_path):
    """The dose of a factor is that of the change around the number that fits the runs."""
    rng, logs, tracks, found = np.random.default_rng(0), [], [], []
    for k in range(16):  # how far the robot turns differs from run to run
        log, turned = rover_log(k, f"run{k}", 4.0), rng.uniform(0.9, 1.1)
        logs.append(log.with_values(["pose.theta"], lambda y, turned=turned: turned * y))
    for track in (GEOMETRY["track_width"], GEOMETRY["track_width"] / 4.0):
        geometry = {**GEOMETRY, "track_width": track}
        numbers = "\n".join(f"{name} = {value}" for name, value in geometry.items())
        (tmp_path / "robot.toml").write_text(f'name = "rover"\nplant = "diff_drive"\n[parameters]\n{numbers}\n')
        settings = (Setting("*", "", geometry),)
        before, after = (Half("rover", "diff_drive", tuple(part), settings) for part in (logs[:8], logs[8:]))
        untouched = UntouchedHalves.of(load_robot(tmp_path / "robot.toml").file, before, after)
        fitted = untouched._fitted(TRACK, None, "scale")
        tracks.append(track / fitted)
        base, changed = (untouched._with(TRACK, None, {"scale": fitted * x}) for x in (1.0, 1.1))
        found.append(visibility(base, changed))
    assert tracks[0] > GEOMETRY["track_width"]  # as if it were wider, since the model has no limit of speed
    assert tracks[1] == pytest.approx(tracks[0], rel=0.05) and found[1] == pytest.approx(found[0], rel=0.2)


def test_all_windows_of_short_runs_of_a_few_equations_are_used(tmp_path):
    (tmp_path / "robot.toml").write_text('name = "rover"\nplant = "diff_drive"\n')
    logs = [rover_log(k, f"run{k}", 10.0) for k in range(20)]
    halves = (
        Half("rover", "diff_drive", tuple(part), (Setting("*", "", GEOMETRY),)) for part in (logs[:10], logs[10:])
    )
    errors = window_errors(load_robot(tmp_path / "robot.toml").file, *halves)
    assert len(errors.key) >= 20 * 9


def kind(effect: str) -> Kind:
    return Kind(effect, "log", "", effect, lambda half: (None,), lambda *_: {"x": 1.0}, lambda half, *_: half)


RECIPE = Recipe("case-0001", 0, 1, 0, 3, False)


def test_a_change_that_the_runs_cannot_show_is_not_drawn():
    carried = ((kind("a"), (None,)), (kind("b"), (None,)))

    def size(of: Kind, *_: object) -> Sized | None:
        return None if of.effect == "a" else Sized({"x": 2.0}, 4.0)

    (change,) = draw(carried, RECIPE, np.random.default_rng(0), size)
    assert (change.kind.effect, change.sizes, change.visibility) == ("b", {"x": 2.0}, 4.0)


def test_runs_that_show_no_kind_are_refused():
    with pytest.raises(BadInput, match="even the largest change of every kind is invisible"):
        draw(((kind("a"), (None,)),), RECIPE, np.random.default_rng(0), lambda *_: None)


def test_runs_that_come_in_groups_scatter_by_their_groups():
    """Two groups that are far apart, as runs on two grounds, with more than half of the runs close together: a spread
    from medians alone would see the close ones only."""
    rng, later = np.random.default_rng(5), np.arange(16) % 2 == 0
    y = np.where(np.arange(16) < 10, 0.0, 5.0) + 0.1 * rng.normal(size=16)
    error = _standard_error(y, np.full(16, 0.5), later)
    assert error > 0.5 * np.hypot(*(np.std(y[side], ddof=1) / np.sqrt(8) for side in (later, ~later)))
