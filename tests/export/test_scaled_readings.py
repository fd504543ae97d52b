"""A scaled, low-passed or skewed sensor reads the same in the stepped simulator as in the replay of the diagnosis."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import build_dataset
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.export.simulator import corrected_simulator
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, assemble

PERIOD, SCALE, BIAS, LAG = 0.02, 1.07, 0.1, 0.12  # s, 1, rad, s
START = {"pose.x": 0.3, "pose.y": -0.2, "pose.theta": 0.8}  # m, m, rad


def simulator(folder: Path, rows: int = 1, lag: float = 0.0, skew: float = 0.0):  # type: ignore[no-untyped-def]
    (folder / "robot.toml").write_text(
        'name = "rover"\nplant = "diff_drive"\n[parameters]\nwheel_radius = 0.033\ntrack_width = 0.16\n'
    )
    values = [
        {"effect": "sensor_scale", "target": "pose.theta", "parameter": "scale", "value": SCALE},
        {"effect": "sensor_bias", "target": "pose.theta", "parameter": "bias", "value": BIAS},
    ]
    lags = [{"effect": "sensor_lag", "target": "pose", "parameter": "time_constant", "value": lag}]
    values += lags if lag else []
    values += [{"effect": "clock_skew", "target": "pose", "parameter": "rate", "value": skew}] if skew else []
    document = {"schema": "residual-mpc/model/1", "robot": "rover", "values": values, "robot_file": "robot.toml"}
    (folder / "model.json").write_text(json.dumps(document))
    return corrected_simulator(folder / "model.json", rows=rows, period=PERIOD)


@pytest.mark.parametrize(("lag", "skew"), [(0.0, 0.0), (LAG, 0.0), (0.0, 0.1), (LAG, 0.05)])
def test_the_simulator_reads_what_the_replay_predicts(tmp_path: Path, lag: float, skew: float) -> None:
    stepped = simulator(tmp_path, lag=lag, skew=skew)
    u = 3.0 * (1.0 - np.cos(2.0 * np.pi * np.outer(PERIOD * np.arange(50), [0.9, 1.7])))  # rad/s, from rest
    seen = [stepped.reset(START)] + [stepped.step(row) for row in u]
    t = PERIOD * np.arange(len(u) + 1)
    held = np.vstack([u, u[-1:]])
    columns = {"command.left": held[:, 0], "command.right": held[:, 1]}
    columns |= {c: np.array([s[c][0] for s in seen]) for c in START}
    robot = DiffDrive("rover", 0.033, 0.16)
    data = build_dataset([Run("one", t, columns)], [robot], dict.fromkeys(START, 1e-4))
    values = {Knob("sensor_scale", "pose.theta", "scale"): SCALE, Knob("sensor_bias", "pose.theta", "bias"): BIAS}
    values |= {Knob("sensor_lag", "pose", "time_constant"): lag} if lag else {}
    values |= {Knob("clock_skew", "pose", "rate"): skew} if skew else {}
    slots = {k.effect: robot.slots(k.effect) for k in values}
    predicted = predict(data, assemble([values], slots))[0, 0]
    np.testing.assert_allclose(predicted, data.y[0], atol=1e-3)  # the start comes from a quadratic
    turned = columns["pose.theta"] - columns["pose.theta"][0]
    assert abs(columns["pose.theta"][0] - START["pose.theta"] - BIAS) < 1e-12 and np.ptp(turned) > 0.2


@pytest.mark.parametrize("skew", [0.0, 0.5])
def test_a_future_that_was_tried_leaves_no_trace_in_the_low_pass(tmp_path: Path, skew: float) -> None:
    stepped = simulator(tmp_path, lag=LAG, skew=skew)
    stepped.reset(START)
    stepped.step([3.0, 1.0])
    here = stepped.save()
    expected = stepped.step([1.0, 2.0])
    stepped.restore(here)
    stepped.step([-4.0, 4.0])
    stepped.restore(here)
    again = stepped.step([1.0, 2.0])
    assert all(np.array_equal(expected[c], again[c]) for c in expected)


def test_each_row_scales_what_it_turned_itself(tmp_path: Path) -> None:
    both = simulator(tmp_path, rows=2)
    both.reset({"pose.theta": np.array([0.5, -1.0])})
    both.step([-2.0, 2.0])
    before = both.step([-2.0, 2.0])["pose.theta"]
    after = both.reset({"pose.theta": 2.0}, where=np.array([False, True]))["pose.theta"]
    np.testing.assert_allclose(after, [before[0], 2.0 + BIAS], atol=1e-12)
    last = both.step([-2.0, 2.0])["pose.theta"]
    step = (before[0] - 0.5 - BIAS) / 2
    np.testing.assert_allclose(last, [before[0] + step, 2.0 + BIAS + step], atol=1e-12)


def test_a_clock_that_gains_makes_readings_later_and_later(tmp_path: Path) -> None:
    """On a straight line at a steady speed, the way that is missing is that of the time that is missing."""
    skew, wheel = 0.25, 4.0  # 1, rad/s
    late, prompt = simulator(tmp_path, skew=skew), simulator(tmp_path)
    for k in range(1, 61):
        missing = prompt.step([wheel, wheel])["pose.x"][0] - late.step([wheel, wheel])["pose.x"][0]
        wanted = 0.033 * wheel * k * PERIOD * skew / (1.0 + skew)
        np.testing.assert_allclose(missing, wanted, atol=1e-9)


def test_a_clock_that_loses_takes_back_a_delay_and_no_more(tmp_path: Path) -> None:
    fast, prompt = simulator(tmp_path, skew=-0.5), simulator(tmp_path)
    for _ in range(5):
        seen, there = fast.step([3.0, 1.0]), prompt.step([3.0, 1.0])
        assert all(np.array_equal(seen[c], there[c]) for c in seen)
