"""Effects that act in a part of the runs alone are named with that part, and no others are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import SIGMA, rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales
from residual_mpc.diagnosis.data.parts import after, before, grouped, groups_of, in_runs
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.phases.certainty import _alike
from residual_mpc.diagnosis.phases.remaining import better, compared, window_errors
from residual_mpc.diagnosis.phases.splits import Split, Timeline, _step, sharpened, timeline_of, with_held_runs
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.group_space import group_space
from residual_mpc.diagnosis.predict.noise_errors import start_errors
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.diagnosis.results.settings import PartSettings, ResultSettings
from residual_mpc.experiment.lasting import lasting
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, Settings, Term

ROVER = DiffDrive("rover", 0.033, 0.16)
TRACK, LAG = Knob("track_width", None, "scale"), Knob("actuator_lag", None, "time_constant")
WIDE: dict[str, dict[str, float]] = {"track_width": {"scale": 1.3}}
SLOW: dict[str, dict[str, float]] = {"actuator_lag": {"time_constant": 0.15}}
AT = 8.0  # s
Faults = Mapping[str, Mapping[str, float]]


def switched(name: str, first: Faults, then: Faults, seed: int) -> Run:
    """A rover whose faults change at the instant AT: the second log, moved to where the first one ends."""
    one, other = rover_run(name, first, seed=seed), rover_run(name, then, seed=seed)
    late, k = one.t >= AT, int(np.searchsorted(one.t, AT))
    x, y, heading = (one.columns[f"pose.{c}"] for c in ("x", "y", "theta"))
    p, q, turned = (other.columns[f"pose.{c}"] for c in ("x", "y", "theta"))
    angle = heading[k] - turned[k]
    c, s = np.cos(angle), np.sin(angle)
    moved = {
        "pose.x": x[k] + c * (p - p[k]) - s * (q - q[k]),
        "pose.y": y[k] + s * (p - p[k]) + c * (q - q[k]),
        "pose.theta": turned + angle,
    }
    return replace(one, columns={c: np.where(late, moved.get(c, v), v) for c, v in one.columns.items()})


def answered(runs: list[Run]) -> dict[str, Any]:
    only = ("track_width", "actuator_lag", "wheel_radius", "command_delay", "dead_zone")
    made = diagnose(runs, [ROVER] * len(runs), SIGMA, (), Options(only=only), np.random.default_rng(0))
    return to_document(made.diagnosis)


@pytest.fixture(scope="module")
def begun() -> dict[str, Any]:
    """A lag in all runs; the track is wide from the middle of the third run on."""
    both = {**SLOW, **WIDE}
    runs = [rover_run(f"r{i}", SLOW, seed=i) for i in range(2)]
    return answered([*runs, switched("r2", SLOW, both, 2), *(rover_run(f"r{i}", both, seed=i) for i in (3, 4))])


def test_an_effect_that_begins_is_named_with_its_instant(begun: dict[str, Any]) -> None:
    assert begun["verdict"] == "effects"
    track, lag = (next(e for e in begun["explanation"] if e["effect"] == k.effect) for k in (TRACK, LAG))
    assert track["parameters"]["scale"]["value"] == pytest.approx(1.3, abs=0.02) and track["probability"] > 0.9
    assert track["since"]["run"] == "r2" and abs(track["since"]["t"] - AT) <= 2.0  # a held-out stretch may lie there
    assert lag["parameters"]["time_constant"]["value"] == pytest.approx(0.15, abs=0.02)
    assert "since" not in lag and "by_run" not in lag
    assert {v["effect"] for v in begun["model"]["values"]} == {TRACK.effect, LAG.effect}
    assert begun["gap"]["after"] < 1.3 * begun["gap"]["noise_floor"]


def test_an_effect_that_ends_is_not_in_the_model_at_the_end() -> None:
    runs = [*(rover_run(f"r{i}", WIDE, seed=i) for i in range(2)), switched("r2", WIDE, {}, 2)]
    found = answered([*runs, *(rover_run(f"r{i}", {}, seed=i) for i in (3, 4))])
    (track,) = found["explanation"]
    assert track["effect"] == TRACK.effect and track["until"]["run"] == "r2" and abs(track["until"]["t"] - AT) <= 2.0
    assert found["verdict"] == "effects" and found["model"]["values"] == []
    assert any("left out of model.json" in note for note in found["notes"])


def test_an_effect_in_some_runs_is_named_with_these() -> None:
    found = answered([rover_run(f"r{i}", WIDE if i in (1, 4) else {}, seed=i) for i in range(6)])
    (track,) = found["explanation"]
    assert track["effect"] == TRACK.effect and track["parameters"]["scale"]["value"] == pytest.approx(1.3, abs=0.02)
    assert {run for run, size in track["by_run"].items() if size != 1.0} == {"r1", "r4"}


def test_a_steady_effect_has_no_part() -> None:
    """Even where the robot stands in half of the runs."""
    runs = [rover_run(f"r{i}", WIDE, seed=i) for i in range(2)]
    still = [replace(r, name=f"still{i}", columns=_standing(r)) for i, r in enumerate(runs)]
    found = answered([*still, *runs])
    (track,) = found["explanation"]
    assert not {"since", "until", "by_run"} & track.keys()


def _standing(run: Run) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    return {c: SIGMA[c] * rng.standard_normal(v.size) if c in SIGMA else 0.0 * v for c, v in run.columns.items()}


def test_the_windows_across_the_instant_lie_in_neither_side() -> None:
    data = build_dataset([rover_run(f"r{i}", {}, seed=i) for i in range(3)], [ROVER] * 3, SIGMA)
    part = after((1, 7.5), (1, 7.5), 3)
    inside, outside = part.inside(data), part.outside(data)
    assert inside[data.run == 2].all() and outside[data.run == 0].all()
    assert (data.run == 1)[~inside & ~outside].all() and (~inside & ~outside).sum() == 1
    reverse = before((1, 7.5), (1, 7.5), 3)
    assert np.array_equal(reverse.inside(data), outside) and np.array_equal(reverse.outside(data), inside)
    some = in_runs([0, 2], [1])
    assert np.array_equal(some.inside(data), data.run != 1) and np.array_equal(some.outside(data), data.run == 1)


def line_of(*counts: int) -> Timeline:
    """Runs of so many windows."""
    run = np.repeat(np.arange(len(counts)), counts)
    start = np.concatenate([np.arange(float(n)) for n in counts])
    runs = tuple(Run(f"r{i}", np.arange(n + 1.0), {}) for i, n in enumerate(counts))
    return Timeline(runs, run, start, 1.0)


def held(line: Timeline, split: Split, acts: np.ndarray, *runs: int) -> Split:
    """The split with held-out runs, in which the effects act in these windows (W,) bool."""
    inside, outside = np.where(acts, 0.1, 1.0), np.where(acts, 1.0, 0.1)
    return with_held_runs(line, split, ~np.isin(line.run, runs), inside, outside, PartSettings())


def test_a_held_out_run_is_judged_on_its_second_half() -> None:
    line = line_of(20, 20, 20)
    for acts in (True, False):
        part = held(line, Split(in_runs([1], [0])), np.full(60, acts), 2).part
        there, elsewhere = (part.inside, part.outside) if acts else (part.outside, part.inside)
        assert there(line)[40:].tolist() == [k >= 10 for k in range(20)] and not elsewhere(line)[40:].any()
    told = Split(in_runs([1], [0, 2]))
    assert held(line, told, np.full(60, True), 2) == told


@pytest.mark.parametrize("begins", [True, False])
def test_an_effect_may_begin_or_end_in_a_held_out_run(begins: bool) -> None:
    """In a run between the two sides of a split in time; every other of its windows is judged."""
    line = line_of(20, 24, 20)
    acts = (line.start >= 9.0) == begins
    split = held(line, Split(in_runs(*(([2], [0]) if begins else ([0], [2]))), 20, begins), acts, 1)
    variation = split.variation(line.runs)
    assert variation is not None
    at = variation.since if begins else variation.until
    assert at is not None and at.run == "r1" and at.t == pytest.approx(9.0, abs=1.0)
    inside, outside = split.part.inside(line)[20:44], split.part.outside(line)[20:44]
    assert not (inside & outside).any() and not (inside | outside)[::2].any()
    assert (inside <= acts[20:44]).all() and (outside <= ~acts[20:44]).all()
    assert min(inside.sum(), outside.sum()) >= 4


def test_one_instant_is_chosen_for_all_held_out_runs_between_the_sides() -> None:
    line = line_of(10, 24, 24, 10)
    acts = (line.run > 1) | ((line.run == 1) & (line.start >= 16.0))
    split = held(line, Split(in_runs([3], [0]), 10, True), acts, 1, 2)
    inside, outside = split.part.inside(line), split.part.outside(line)
    assert inside[line.run == 2].sum() == 12 and not outside[line.run == 2].any()
    assert (inside <= acts).all() and (outside <= ~acts).all()


def test_an_instant_in_a_held_out_run_has_to_be_clear() -> None:
    """Where the effects gain nothing in particular, a run lies on one side, and a short one is no problem."""
    rng, dated = np.random.default_rng(3), 0
    line = line_of(10, 40, 10)
    for _ in range(100):
        inside, outside = rng.exponential(size=(2, 60))
        part = with_held_runs(line, Split(in_runs([2], [0]), 10, True), line.run != 1, inside, outside, PartSettings())
        dated += 1 in part.part.where and 1 in part.part.rest
    assert dated <= 15
    short = line_of(10, 2, 10)
    assert held(short, Split(in_runs([2], [0]), 10, True), np.full(22, True), 1).part.inside(short)[10:12].sum() == 1


def test_an_effect_does_nothing_outside_its_part() -> None:
    data = build_dataset([rover_run(f"r{i}", {}, seed=i) for i in range(3)], [ROVER] * 3, SIGMA)
    part, space = after((1, 7.0), (1, 7.0), 3), build_space(data, ())
    told = grouped(data, groups_of(data, part))
    values = {TRACK: 1.2, LAG: 0.1}
    row = group_space(space, [{TRACK.term: 0.0}]).settings([values])
    both, alone = predict(data, space.settings([values, {LAG: 0.1}]))
    found, inside = predict(told, row)[0], part.inside(told)
    assert told.count == data.count  # no window lies across 7 s
    assert np.array_equal(found[inside], both[part.inside(data)], equal_nan=True)
    assert np.array_equal(found[~inside], alone[part.outside(data)], equal_nan=True)
    assert np.array_equal(row.take(np.array([0])).others[0].effects["actuator_lag"]["time_constant"], [[0.1, 0.1]])


def test_a_level_changes_only_beyond_doubt() -> None:
    rng, settings = np.random.default_rng(3), PartSettings()
    places = np.arange(settings.fewest, 60 - settings.fewest + 1)
    flat = rng.standard_normal(60)
    assert _step(flat, places, settings) is None
    assert _step(flat + 5.0 * (np.arange(60) >= 20), places, settings) == (20, True)
    assert _step(flat - 5.0 * (np.arange(60) >= 20), places, settings) == (20, False)
    assert _step(0.01 * flat + 0.5 * (np.arange(60) >= 20), places, settings) is None  # hardly larger


def test_the_instant_moves_to_where_the_windows_show_it() -> None:
    data = build_dataset([rover_run("r0", {}, seconds=30.0)], [ROVER], SIGMA)
    line, _ = timeline_of(data)
    true, n = 14, line.run.size
    inside, outside = np.where(np.arange(n) < true, 1.0, 0.01), np.where(np.arange(n) < true, 0.01, 1.0)
    inside[true] = 0.4  # the instant lies within this window
    found = sharpened(line, Split(after((0, 12.0), (0, 12.0), 1), 12), inside, outside, PartSettings())
    assert found.at == true and found.part.rest[0][1] == pytest.approx(line.start[true])
    assert found.part.where[0][0] == pytest.approx(line.start[true] + line.horizon)


def test_a_size_that_differs_between_runs_is_fitted_for_each() -> None:
    """Held-out runs included: their sizes come from the first half of each, which is then not judged."""
    true = [1.0, 1.05, 1.12, 1.2, 1.27, 1.35]
    runs = [rover_run(f"r{i}", {**SLOW, "track_width": {"scale": x}}, seed=i) for i, x in enumerate(true)]
    found = answered(runs)
    track, lag = (next(e for e in found["explanation"] if e["effect"] == k.effect) for k in (TRACK, LAG))
    assert list(track["by_run"].values()) == pytest.approx(true, abs=0.015) and track["probability"] > 0.7
    assert lag["parameters"]["time_constant"]["value"] == pytest.approx(0.15, abs=0.02) and "by_run" not in lag
    assert found["verdict"] == "effects" and found["gap"]["after"] < 1.3 * found["gap"]["noise_floor"]
    values = {v["effect"]: v["value"] for v in found["model"]["values"]}
    assert values["track_width"] == pytest.approx(true[-1], abs=0.015)  # the robot as it is in the last run
    low, high = track["parameters"]["scale"]["ci95"]
    assert low < np.mean(true) < high and high - low > 0.1  # the runs disagree


def test_the_noise_floor_does_not_depend_on_how_the_windows_are_grouped() -> None:
    data = build_dataset([rover_run("r0", {}, seconds=30.0)], [ROVER], SIGMA)
    parts = grouped(data, groups_of(data, after((0, 12.0), (0, 12.0), 1)))
    noise = {key: np.ones(len(s.y)) for key, s in data.signals.items()}
    one, two = (start_errors(d, Settings(1), noise) for d in (data, parts))
    assert parts.blocks[1:] and one.keys() == two.keys()
    for channel, error in one.items():
        np.testing.assert_allclose(two[channel], error)


def test_few_stretches_prove_nothing() -> None:
    data = build_dataset([rover_run("r0", {}, seconds=30.0)], [ROVER], SIGMA)
    few, settings = data.take(np.arange(data.count) < 6), ResultSettings()
    large, small = np.full(data.count, 0.1), np.full(data.count, 0.001) * (1.0 + 0.01 * np.arange(data.count))
    assert better(data, small, large, settings.parts, settings.fit)
    assert not better(few, small[:6], large[:6], settings.parts, settings.fit)


def test_windows_without_a_sample_say_nothing() -> None:
    data = build_dataset([rover_run("r0", {}, seconds=10.0)], [ROVER], SIGMA)
    y = data.y.copy()
    y[3] = np.nan
    blind, predicted = replace(data, y=y), np.zeros_like(y)
    predicted[4] = np.nan  # diverged
    errors = window_errors(blind, measure_scales(data), predicted)
    assert errors[3] == 0.0 and errors[4] == 1.0 and not compared(blind)[3] and compared(blind)[4]


def test_what_ended_cannot_be_tested_on_new_runs() -> None:
    gone, stays = {"effect": "command_delay", "target": None}, {"effect": "track_width", "target": None}
    value = {**stays, "parameter": "scale", "value": 1.2}
    both = [value, {**gone, "parameter": "delay", "value": 0.1}]
    document = {
        "explanation": [{**gone, "until": {"run": "r1", "t": 3.0}}, stays],
        "model": {"values": [value]},
        "alternatives": [{"instead_of": [gone], "values": both}, {"instead_of": [stays], "values": both}],
    }
    explanation, alternatives = lasting(document)
    assert explanation == [stays] and alternatives == [{"instead_of": [stays], "values": [value]}]


@pytest.mark.parametrize("sizes", [(1.0, 1.0, 0.9, 0.9), (0.97, 0.93, 0.87, 0.82)])
def test_what_cannot_be_told_apart_stays_a_group(sizes: tuple[float, ...]) -> None:
    """Without encoders, a weak motor acts like wheels of unequal size; either may begin, or differ between runs."""
    faults = [{"wheel_radius_mismatch": {"ratio": x}} for x in sizes]
    runs = [rover_run(f"r{i}", fault, seed=i) for i, fault in enumerate(faults)]
    only = ("wheel_radius_mismatch", "actuator_gain", "track_width", "command_delay")
    made = diagnose(runs, [ROVER] * len(runs), SIGMA, (), Options(only=only), np.random.default_rng(0))
    found = to_document(made.diagnosis)
    (named,) = found["explanation"]
    (group,) = found["confounded"]
    assert {m["effect"] for m in group} >= {"wheel_radius_mismatch", "actuator_gain"}
    assert named["probability"] < 0.6 and ("since" in named or "by_run" in named)


def test_a_limit_may_be_another_size_of_one_that_acts_in_a_part() -> None:
    saturation, shared, lag = (Term(e, None) for e in ("saturation", "shared_limit", "actuator_lag"))
    assert _alike(shared, saturation) and not _alike(lag, saturation)
    assert not _alike(TRACK.term, LAG.term)


def test_the_values_of_a_group_hold_alone() -> None:
    rest = Settings(1, {"track_width": {"scale": np.full((1, 1), 1.2)}})
    both = Settings(1, others=(rest,))
    assert both.of_group(1) is rest and both.of_group(0).others == () and rest.of_group(1).effects is rest.effects
