"""diagnosis.json of every verdict: its keys, its numbers, and what each verdict promises.

The logs come from a literal simulator of the rover's own, not from the library's replay.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oracles.rover_euler import TRACK_WIDTH, WHEEL_RADIUS
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.remainder.learning import Learned
from residual_mpc.diagnosis.results.document import to_document
from residual_mpc.effects.library import BY_NAME
from residual_mpc.logs.run import Run
from residual_mpc.models.model_file import DIAGNOSIS_SCHEMA, MODEL_SCHEMA

ROVER = DiffDrive("rover", WHEEL_RADIUS, TRACK_WIDTH)
TRACK = {"track_width": {"scale": 1.25}}
GUSTS = {"gusts": {"size": 0.8}}  # a push that no effect of the library explains
CASES: dict[str, tuple[dict[str, dict[str, float]], Options]] = {
    "no_gap": ({}, Options()),
    "effects": (TRACK, Options()),
    "partial": ({**TRACK, **GUSTS}, Options(only=("track_width",))),
    "unknown": (GUSTS, Options()),
}
SECONDS = {"unknown": (14.0, 10.0)}  # the search through all effects takes long
KEYS = {
    "schema", "robot", "verdict", "held_out", "gap", "shrink", "where", "explanation", "candidates", "confounded",
    "not_testable", "moved", "unexplained", "next_experiment",
}  # fmt: skip


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[str, dict[str, Any]]:
    faults, options = CASES[request.param]
    one, two = SECONDS.get(request.param, (24.0, 16.0))
    runs = [rover_run("one", faults, one, seed=1), rover_run("two", faults, two, seed=2)]
    made = diagnose(runs, [ROVER] * 2, {}, (), options, np.random.default_rng(0))
    return request.param, to_document(made.diagnosis)


def numbers(x: Any) -> list[float]:
    if isinstance(x, dict):
        return [n for v in x.values() for n in numbers(v)]
    if isinstance(x, list):
        return [n for v in x for n in numbers(v)]
    return [float(x)] if isinstance(x, int | float) else []


def test_the_keys_of_the_contract(case: tuple[str, dict[str, Any]]) -> None:
    _, d = case
    assert set(d) >= KEYS and d["schema"] == DIAGNOSIS_SCHEMA and d["robot"] == "rover"
    assert set(d["gap"]) >= {"before", "after", "noise_floor", "horizon"}
    assert set(d["where"]) >= {"stages", "channels", "regimes", "times"}
    assert set(d["unexplained"]) >= {"share", "learned_residual_shrink"}
    for entry in d["where"]["stages"] + d["where"]["channels"]:
        assert set(entry) >= {"name", "share"}
    assert all(set(r) >= {"name", "share", "lift"} for r in d["where"]["regimes"])
    assert all(set(t) >= {"run", "from", "to", "share"} for t in d["where"]["times"])
    for cause in d["explanation"]:
        assert set(cause) >= {"effect", "target", "probability", "parameters"}
        wanted = {p.name: p.unit for p in BY_NAME[cause["effect"]].parameters}
        assert {n: p["unit"] for n, p in cause["parameters"].items()} == wanted
        for p in cause["parameters"].values():
            assert p["ci95"][0] <= p["value"] <= p["ci95"][1]
    assert all(set(c) >= {"effect", "target", "probability", "shrink"} for c in d["candidates"])
    assert all(set(n) >= {"effect", "target", "why"} for n in d["not_testable"])


def test_nothing_in_it_is_no_number(case: tuple[str, dict[str, Any]]) -> None:
    _, d = case
    assert json.loads(json.dumps(d, allow_nan=False)) == d
    assert all(math.isfinite(n) for n in numbers(d))
    assert all(isinstance(d["gap"][k], float) for k in ("nominal", "before", "after", "noise_floor"))


def test_what_json_has_no_number_for_becomes_null() -> None:
    made = diagnose([rover_run("one", {}, 8.0)], [ROVER], {}, (), Options(), np.random.default_rng(0))
    d = to_document(replace(made.diagnosis, learned=Learned(float("nan")), unexplained=float("inf")))
    assert d["unexplained"] == {"share": None, "learned_residual_shrink": None}


def test_the_verdict(case: tuple[str, dict[str, Any]]) -> None:
    wanted, d = case
    assert d["verdict"] == wanted


def test_what_a_verdict_promises(case: tuple[str, dict[str, Any]]) -> None:
    _, d = case
    gap, share = d["gap"], d["unexplained"]["share"]
    if d["verdict"] in ("no_gap", "unknown"):
        assert d["explanation"] == [] and d["shrink"] is None and d["confounded"] == []
        assert gap["after"] == gap["before"] and share == (0.0 if d["verdict"] == "no_gap" else 1.0)
        return
    assert d["explanation"] and gap["after"] < gap["before"]
    assert (share <= 0.25) == (d["verdict"] == "effects")
    excess = (gap["after"] ** 2 - gap["noise_floor"] ** 2) / (gap["before"] ** 2 - gap["noise_floor"] ** 2)
    assert share == pytest.approx(min(max(excess, 0.0), 1.0), abs=1e-9)
    shrink = d["shrink"]
    assert shrink["value"] == pytest.approx(1 - gap["after"] / gap["before"], abs=1e-9)
    for value, interval in (("value", "ci95"), ("expected", "expected_ci95")):
        assert shrink[interval][0] <= shrink[value] <= shrink[interval][1] <= 1.0


def test_shares_and_probabilities(case: tuple[str, dict[str, Any]]) -> None:
    _, d = case
    where = d["where"]
    for name in ("channels", "stages"):
        assert sum(x["share"] for x in where[name]) == pytest.approx(1.0, abs=1e-6)
        assert all(-1e-9 <= x["share"] <= 1 + 1e-9 for x in where[name])
    assert all(0 <= x["share"] <= 1 and x["lift"] >= 0 for x in where["regimes"])
    assert all(0 <= x["probability"] <= 1 for x in d["explanation"] + d["candidates"])


def test_what_was_kept_back_is_whole_windows(case: tuple[str, dict[str, Any]]) -> None:
    _, d = case
    assert d["held_out"]
    for block in d["held_out"]:
        assert set(block) == {"run", "from", "to"} and block["run"] in ("one", "two")
        assert block["to"] - block["from"] == pytest.approx(round(block["to"] - block["from"]))


def test_the_model_holds_what_the_explanation_says(case: tuple[str, dict[str, Any]]) -> None:
    _, d = case
    assert d["model"]["schema"] == MODEL_SCHEMA
    said = {(c["effect"], c["target"], n): p["value"] for c in d["explanation"] for n, p in c["parameters"].items()}
    held = {(v["effect"], v["target"], v["parameter"]): v["value"] for v in d["model"]["values"]}
    assert held == pytest.approx(said)


def test_a_planted_effect_is_measured() -> None:
    faults, _ = CASES["effects"]
    runs = [rover_run("one", faults, 24.0, seed=1)]
    made = diagnose(runs, [ROVER], {}, (), Options(), np.random.default_rng(0))
    (cause,) = made.diagnosis.causes
    (scale,) = cause.parameters
    assert cause.term.effect == "track_width" and scale.value == pytest.approx(1.25, abs=0.02)
    assert scale.ci95[0] < 1.25 < scale.ci95[1] and cause.probability > 0.9
    expected, achieved = made.diagnosis.expected, made.diagnosis.achieved
    assert expected is not None and achieved is not None
    document = to_document(made.diagnosis)
    assert document["explanation"][0]["parameters"]["scale"]["ci95"] == list(scale.ci95)
    assert document["shrink"]["ci95"] == list(achieved.ci95)
    assert document["shrink"]["expected_ci95"] == list(expected.ci95)


def test_a_number_at_the_end_of_what_is_tried_is_said_to_be_there() -> None:
    beyond = {"actuator_gain": {"gain": 7.0}}
    runs = [rover_run("one", beyond, 24.0, seed=1)]
    made = diagnose(runs, [ROVER], {}, (), Options(only=("actuator_gain",)), np.random.default_rng(0))
    (cause,) = made.diagnosis.causes
    assert cause.parameters[0].value == pytest.approx(5.0)
    assert any("gain of actuator_gain is at the bound of its search range, 5" in n for n in made.diagnosis.notes)


def test_what_cannot_be_told_apart_shares_a_probability() -> None:
    runs = [rover_run("one", {"wheel_radius": {"scale": 1.15}}, 24.0, seed=1)]
    options = Options(only=("wheel_radius", "actuator_gain", "track_width"))
    document = to_document(diagnose(runs, [ROVER], {}, (), options, np.random.default_rng(0)).diagnosis)
    said = {c["effect"]: c["probability"] for c in document["candidates"] if c["target"] is None}
    assert document["confounded"] and {"wheel_radius", "actuator_gain"} <= set(said)
    assert said["wheel_radius"] + said["actuator_gain"] <= 0.971
    assert 0.2 < said["wheel_radius"] < 0.8
    assert document["explanation"][0]["probability"] == said[document["explanation"][0]["effect"]]


def spoilt(seed: int, *samples: int, effects: dict[str, dict[str, float]] = TRACK) -> Run:
    """A minute of a rover, wide by default, whose localisation jumps away at a few of 3000 samples."""
    run = rover_run("one", effects, 60.0, rate=50.0, seed=seed)
    x = run.columns["pose.x"].copy()
    x[list(samples)] += 2.0
    return replace(run, columns={**run.columns, "pose.x": x})


@pytest.fixture(scope="module")
def with_jumps() -> Run:
    return spoilt(3, 220, 510, 1290, 1830, 2410)  # the second one is in what is held out


def test_a_few_jumps_are_a_cause_where_they_make_up_much_of_what_is_left(with_jumps: Run) -> None:
    options = Options(only=("track_width", "sensor_outliers"))
    made = diagnose([with_jumps], [ROVER], {}, (), options, np.random.default_rng(0)).diagnosis
    named = {c.term.effect: c for c in made.causes}
    assert set(named) == {"track_width", "sensor_outliers"} and made.verdict == "effects"
    (rate,) = named["sensor_outliers"].parameters
    assert rate.value == pytest.approx(5 / 3000, rel=0.3) and 0.0 < rate.ci95[0] < 5 / 3000 < rate.ci95[1]


def test_a_promise_counts_the_jumps_that_are_not_named(with_jumps: Run) -> None:
    options = Options(only=("track_width",))
    made = diagnose([with_jumps], [ROVER], {}, (), options, np.random.default_rng(0)).diagnosis
    assert made.expected is not None and made.achieved is not None
    assert made.expected.ci95[0] <= made.achieved.value <= made.expected.ci95[1]
    assert made.achieved.value < 0.6  # the jumps stay


def test_jumps_whose_effect_is_excluded_are_a_gap_that_nothing_explains() -> None:
    run = spoilt(4, 220, 510, 1290, 1830, 2410, effects={})
    allowed, excluded = Options(only=("track_width", "sensor_outliers")), Options(only=("track_width",))
    verdicts = [
        diagnose([run], [ROVER], {}, (), o, np.random.default_rng(0)).diagnosis.verdict for o in (allowed, excluded)
    ]
    assert verdicts == ["effects", "unknown"]
