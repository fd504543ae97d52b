"""Two sets of runs of a simulated rover, from the logs to the answer."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from comparison.rovers import write_sets

import residual_mpc as rm

ANSWER = {"verdict", "changes", "confounded", "gap", "unexplained"}  # contract, section 8
SOME = ("track_width", "wheel_radius", "actuator_gain", "actuator_lag", "command_delay", "sensor_lag", "saturation")
GAPS = {"before", "after", "after_explained", "noise_floor"}


def compared(folder: Path, only: tuple[str, ...] = ()) -> rm.Comparison:
    robot = rm.load_robot(folder / "robot.toml")
    sets = (rm.read_runs(robot, folder / name) for name in ("before", "after"))
    return rm.compare(robot, *sets, only=only, out=folder / "out")


@pytest.fixture(scope="module")
def same(tmp_path_factory: pytest.TempPathFactory) -> rm.Comparison:
    """Other motions, same robot, whose track the model has wrong."""
    return compared(write_sets(tmp_path_factory.mktemp("same"), seed=0))


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> tuple[rm.Comparison, Path]:
    """The same robot with a tenth more track after."""
    folder = write_sets(tmp_path_factory.mktemp("wide"), track=1.1, seed=0)
    return compared(folder, SOME), folder / "out"


def test_runs_of_the_same_robot_are_the_same(same: rm.Comparison) -> None:
    """Though the model is wrong: what it gets wrong is common to both sets."""
    assert same.verdict == "same" and same.changes == []
    shift = ["command_delay", "sensor_lag"]  # the encoders are ahead of the pose by 10 ms
    assert [t["effect"] for t in same.document["account"]] == ["track_width", *shift]
    assert same.document["unexplained"] == {"share": 0.0, "p": pytest.approx(same.document["unexplained"]["p"])}
    assert same.gap["after"] == same.gap["after_explained"] < 1.5 * same.gap["before"]
    assert len(same.to_frame()) == 0 and str(same).startswith("No change found")


def test_a_wider_track_is_named_with_its_ratio(wide: tuple[rm.Comparison, Path]) -> None:
    found, _ = wide
    assert found.verdict == "changed"
    (change,) = found.changes
    assert change["effect"] == "track_width" and change["target"] is None and change["probability"] > 0.9
    (scale,) = change["parameters"].values()
    low, high = scale["change"]["ci95"]
    assert low <= 1.1 <= high and high - low < 0.05
    predicts = change["predicts"]
    assert predicts["gain"] > 3.0 * predicts["error"] > 0.0 and predicts["better"] > 0.9
    assert scale["before"] == pytest.approx(1.06, abs=0.01) and scale["after"] == pytest.approx(1.166, abs=0.02)
    assert found.gap["after"] > 1.5 * found.gap["before"] > found.gap["after_explained"]
    assert "effective track width increased by" in str(found)


def test_the_frame_has_a_row_for_each_number(wide: tuple[rm.Comparison, Path]) -> None:
    (row,) = wide[0].to_frame().itertuples()
    assert (row.effect, row.parameter, row.unit) == ("track_width", "scale", "1")
    assert row.low < row.change < row.high and row.after == pytest.approx(row.before * row.change)
    assert "<table" in wide[0]._repr_html_()


@pytest.mark.parametrize("which", ["same", "wide"])
def test_the_answer_has_the_keys_of_the_contract(which: str, request: pytest.FixtureRequest) -> None:
    found = request.getfixturevalue(which)
    document = (found if which == "same" else found[0]).document
    assert document.keys() >= ANSWER and document["gap"].keys() >= GAPS and "share" in document["unexplained"]
    assert document["schema"] == "residual-mpc/comparison/1"
    for change in document["changes"]:
        assert change.keys() >= {"effect", "target", "probability", "parameters"}
        for number in change["parameters"].values():
            assert number.keys() >= {"before", "after", "change"}
            assert number["change"].keys() == {"value", "ci95", "unit"} and len(number["change"]["ci95"]) == 2


def test_the_folder_holds_the_answer_and_its_page(wide: tuple[rm.Comparison, Path]) -> None:
    found, out = wide
    assert {p.name for p in out.iterdir()} == {"comparison.json", "report.html"}
    assert json.loads((out / "comparison.json").read_text()) == found.document
    assert found.document["verdict_sentence"] in (out / "report.html").read_text()


def test_every_run_is_tested_and_runs_of_one_name_are_told_apart(wide: tuple[rm.Comparison, Path]) -> None:
    """Both sets call theirs run1, run2, run3; the gap is that of all their windows, by cross-validation."""
    document = wide[0].document
    assert document["runs"] == {side: ["run1", "run2", "run3"] for side in ("before", "after")}
    assert document["gap"]["folds"] == 4 and set(document["gap"]["windows"].values()) == {27}
