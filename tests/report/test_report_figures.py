"""Drawings and the records behind them."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from fabricated_diagnosis import document, evidence

from residual_mpc.report import Panel, Windows
from residual_mpc.report.evidence import collect
from residual_mpc.report.evidence.held_out import held_out
from residual_mpc.report.figures import inline as inline_module
from residual_mpc.report.figures.curve import curve, law_curve, ripple_curve
from residual_mpc.report.figures.strips import PIECES, strips
from residual_mpc.report.figures.traces import bridged, rms_error, traces

NAN = float("nan")


def test_missing_samples_are_bridged_and_breaks_are_kept():
    signal = np.array([NAN, 1.0, NAN, 3.0, NAN, NAN, 5.0, NAN])
    breaks = np.array([False, False, False, False, False, True, False, False])
    assert np.array_equal(bridged(signal, breaks), [NAN, 1.0, 2.0, 3.0, NAN, NAN, 5.0, NAN], equal_nan=True)


def test_error_of_a_wrapped_heading():
    t = np.arange(3.0)
    panel = Panel("r", "pose.theta", "rad", t, np.full(3, 3.1), np.full(3, -3.1), np.full(3, NAN))
    assert rms_error(panel, panel.before) == pytest.approx(2 * np.pi - 6.2)
    assert np.isnan(rms_error(panel, panel.after))


def test_drawing_follows_the_page_and_has_its_own_ids():
    svg = str(traces(evidence("effects").panels[0], "a", 0.0))
    assert svg.startswith("<svg") and "var(--before)" in svg and "#c2500a" not in svg
    assert "font-family" not in svg and 'id="a-' in svg
    assert "after (0.0154\N{NO-BREAK SPACE}rad (0.88°))" in svg


def test_a_big_drawing_becomes_a_picture_with_its_words(monkeypatch):
    monkeypatch.setattr(inline_module, "LARGEST_SVG", 1000)
    image = str(traces(evidence("effects").panels[0], "a", 0.0))
    assert image.startswith('<img class="paper" src="data:image/png;base64,') and 'alt="pose.theta of run' in image


def test_no_setting_of_matplotlib_stays_behind():
    import matplotlib

    before = dict(matplotlib.rcParams)
    traces(evidence("effects").panels[0], "a", 0.0)
    assert dict(matplotlib.rcParams) == before


def test_held_out_by_run_and_by_block():
    windows = Windows(["a", "a", "b", "b"], np.array([0.0, 1.0, 0.0, 1.0]), np.zeros(4), np.zeros(4))
    kept = document("effects") | {"held_out": ["a"]}
    assert held_out(kept, windows).tolist() == [True, True, False, False]
    kept = document("effects") | {"held_out": [{"run": "b", "from": 1.0, "to": 2.0}]}
    assert held_out(kept, windows).tolist() == [False, False, False, True]


def test_long_runs_are_pooled_and_skipped_windows_left_blank():
    count = 1000
    windows = Windows(["a"] * count, np.arange(float(count)), np.full(count, 0.5), np.zeros(count))
    (strip,) = strips(
        windows, np.zeros(count, dtype=bool), 1.0, 1.0, [{"run": "a", "from": 3.0, "to": 5.0}], lambda run: 0.0
    )
    assert len(strip.pieces) <= PIECES and strip.length == count and strip.marks == ((3.0, 2.0),)
    assert all(piece.level == pytest.approx(0.5) for piece in strip.pieces)
    skipped = Windows(["a"], np.zeros(1), np.full(1, NAN), np.zeros(1))
    (strip,) = strips(skipped, np.ones(1, dtype=bool), 1.0, 1.0, [], lambda run: 0.0)
    assert strip.pieces[0].level is None and strip.gap == 0.0


def test_evidence_of_unequal_lengths_is_refused():
    with pytest.raises(ValueError, match="one length"):
        Panel("r", "c", "m", np.zeros(3), np.zeros(3), np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="no sample"):
        Panel("r", "c", "m", *(np.zeros(0) for _ in range(4)))
    with pytest.raises(ValueError, match="one length"):
        Windows(["a"], np.zeros(2), np.zeros(2), np.zeros(2))


def test_a_coordinate_of_epoch_stamps_has_short_labels():
    stamps = [1.76e9 + 100.0 * k for k in range(8)]
    (depends,) = document("unknown")["remainder"]["depends_on"][1:]
    depends["curve"] |= {"x": stamps}
    svg = str(curve(depends, "elbow", "a"))
    labels = re.findall(r">([^<>]+)</text>", svg)
    assert "the time in the run - 1760000000 (s)" in labels
    assert max(len(label) for label in labels if label.replace(".", "").isdigit()) <= 6


def test_a_panel_shows_windows_that_follow_each_other():
    data = SimpleNamespace(start=np.array([3.0, 12.0, 1.0, 13.0, 0.0, 2.0, 14.0]), horizon=1.0)
    assert collect._around(1, np.array([0, 1, 2, 3, 4, 5, 6]), data).tolist() == [1, 3, 6]
    long = SimpleNamespace(start=np.arange(30.0), horizon=1.0)
    assert collect._around(29, np.arange(30), long).tolist() == list(range(22, 30))


def test_a_law_has_the_band_of_its_intervals(monkeypatch: pytest.MonkeyPatch):
    """They end where a joint has no friction left, on one side alone."""
    bands = []
    monkeypatch.setattr(
        "matplotlib.axes.Axes.fill_between", lambda self, x, low, high, **_: bands.append(np.array([x, low, high]))
    )
    points = {"knots": [0.0, 0.5, 1.0], "values": [-0.03, 0.8, -0.03]}
    sides = {"values_ci95": [[-0.03, 0.7, -0.03], [-0.03, 0.9, 0.6]]}
    law_curve(
        {"of": "friction", "on": "the position of elbow", "form": "curve", "unit": "N m", "on_unit": "rad"}
        | points | sides,
        "law0",
    )  # fmt: skip
    expected = [[-0.15, 0.0, 0.5, 1.0, 1.15], [-0.03, -0.03, 0.7, -0.03, -0.03], [-0.03, -0.03, 0.9, 0.6, 0.6]]
    assert bands[0] == pytest.approx(np.array(expected))


def test_a_ripple_is_drawn_as_one_cycle():
    numbers = {"amplitude": (0.4, 0.1, "N m"), "cycles": (8.0, 0.1, "1/turn"), "phase": (0.0, 0.1, "rad")}
    parameters = {k: {"value": v, "ci95": [v - h, v + h], "unit": unit} for k, (v, h, unit) in numbers.items()}
    svg = str(ripple_curve({"effect": "torque_ripple", "target": "elbow", "parameters": parameters}, "law0"))
    assert "against the angle of elbow: from -0.4 at 0.59 to 0.4 at 0.2" in svg and 'id="law0-' in svg
