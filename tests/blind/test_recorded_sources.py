"""Cases out of the recordings of the shared data, where they are at hand."""

from pathlib import Path

import pytest

from residual_mpc.api.robot import load_robot
from residual_mpc.api.runs import read_runs, usable
from residual_mpc.blind.recorded.kinds.library import carried_by
from residual_mpc.blind.recorded.make import RecordedSettings, changed_halves, make_recorded_suite
from residual_mpc.blind.recorded.recipe import plan

DATA = Path(__file__).parents[2].parent / "shared" / "data"
SHARED = {"sensor_bias", "sensor_outliers", "sensor_delay", "clock_skew"}
ARM = SHARED | {"command_delay", "actuator_gain", "coulomb_friction", "viscous_friction", "payload", "link_mass",
                "armature", "sensor_scale"}  # fmt: skip
CARRIED = {
    "xl330": ARM | {"position_gain"},
    "pendulum/a": ARM | {"link_length"},
    "husky_terrain": SHARED | {"wheel_radius", "wheel_radius_mismatch", "track_width"},
}


@pytest.mark.slow
@pytest.mark.parametrize("source", CARRIED)
def test_a_recording_carries_what_its_log_and_model_allow(source, tmp_path):
    folder = DATA / source
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    robot = load_robot(folder / "robot.toml")
    runs = read_runs(robot, str(folder)).runs
    settings = RecordedSettings(4)
    recipe = plan(robot.name, 4, 0, test=False)[0]
    _, after, _, _ = changed_halves(robot.file, runs, settings, recipe)
    assert {kind.effect for kind, _ in carried_by(after)} == CARRIED[source]
    made = make_recorded_suite(robot.file, runs, settings, tmp_path / "suite", tmp_path / "answers")
    assert len(made.suite.cases) == 4 and not made.failed
    for entry in made.suite.cases:
        case = made.suite.case(entry)
        again = load_robot(case / "robot.toml")
        halves = [usable(read_runs(again, str(case / half))) for half in ("before", "after")]
        assert sum(len(half) for half in halves) == len(runs)
