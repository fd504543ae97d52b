"""Traces of every run: the page's script gets what was measured and what the models predict, in a bounded file."""

from __future__ import annotations

import base64
import json
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run
from report.fabricated_diagnosis import document, evidence
from report.filmed import filmed

import residual_mpc as rm
from residual_mpc.diagnosis.data.gap import per_window
from residual_mpc.diagnosis.results.records import DiagnosisResult
from residual_mpc.models.settings import Knob
from residual_mpc.report.evidence import run_traces as module
from residual_mpc.report.evidence.run_traces import RunTraces, Signals, run_traces
from residual_mpc.report.report import compose


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisResult:
    path = tmp_path_factory.mktemp("rover") / "robot.toml"
    path.write_text(ROBOT)
    robot = rm.load_robot(path).model
    run = rover_run("run1", {"track_width": {"scale": 1.1}}, 8.0)
    found = filmed(run, robot, {Knob("track_width", None, "scale"): 1.1})
    named: Any = found.diagnosis
    named.__dict__.update(where=SimpleNamespace(channels=tuple((c, 1.0 / 3) for c in found.data.channels)))
    return found


def gaps(made: DiagnosisResult) -> tuple[np.ndarray, np.ndarray]:
    before, after = (np.sqrt(per_window(made.data, made.scales, e)) for e in (made.before, made.after))
    return before, after


def test_predictions_are_the_measurement_less_its_error(made: DiagnosisResult) -> None:
    (run,) = run_traces(made, *gaps(made))
    assert (np.diff(run.t) >= 0).all() and len(run.first) == made.data.count
    for signals in run.signals:
        k = made.data.channels.index(signals.channel)
        for w, (first, last) in enumerate(zip(run.first, [*run.first[1:], len(run.t)], strict=True)):
            at = np.searchsorted(made.data.t[w], run.t[first:last] - made.data.start[w] - 1e-9)
            assert signals.measured[first:last] == pytest.approx(made.data.y[w, at, k])
            assert signals.before[first:last] == pytest.approx(made.data.y[w, at, k] - made.before[w, at, k])
            assert signals.after[first:last] == pytest.approx(made.data.y[w, at, k] - made.after[w, at, k])


def test_too_many_windows_leave_those_that_were_held_out(
    made: DiagnosisResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = int(made.held.sum())
    monkeypatch.setattr(module, "VALUES", module.SPARSEST * 3 * 3 * (held + 1))
    (run,) = run_traces(made, *gaps(made))
    assert len(run.first) == held + 1 and int(run.held_out.sum()) == held
    others = np.where(made.held, -np.inf, gaps(made)[0])
    assert run.before[~run.held_out] == pytest.approx([others.max()])  # and the largest gap of the others
    assert len(run.t) <= module.SPARSEST * (held + 1)


def test_a_robot_without_a_place_of_its_gap_has_none(made: DiagnosisResult) -> None:
    bare: Any = SimpleNamespace(**{**made.diagnosis.__dict__, "where": SimpleNamespace(channels=())})
    whole = DiagnosisResult(bare, made.data, made.scales, made.before, made.after, made.held, {})
    assert run_traces(whole, *gaps(made)) == ()


def test_the_page_holds_the_signals_and_what_is_missing() -> None:
    t = np.array([0.0, 0.5, 1.0, 1.5])
    measured = np.array([1.0, np.nan, 2.0, 1.5])
    signals = Signals("pose.x", measured, measured + 0.1, np.full(4, 100.0))
    gaps, held = (np.array([0.2, 0.5]), np.array([0.02, 0.03])), np.array([True, False])
    run = RunTraces("run <3>", t, np.array([0, 2]), *gaps, held, (signals,))
    known = evidence("effects")
    shown = type(known)(known.panels, known.windows, traces=(run,))
    page = compose(document("effects"), shown)
    (data,) = re.findall(r'id="traces-data">(.*?)</script>', page, re.DOTALL)
    assert "<" not in data
    (drawn,) = json.loads(data)["runs"]
    assert drawn["name"] == "run <3>" and drawn["first"] == [0, 2] and drawn["opens"] == 0  # the held-out one
    assert "held out" in drawn["labels"][0] and "held out" not in drawn["labels"][1]
    (channel,) = drawn["channels"]
    low, high = channel["low"], channel["high"]

    def read(text: str) -> np.ndarray:
        steps = np.frombuffer(base64.b64decode(text), "<i2").astype(float)
        return np.where(steps == -32768, np.nan, low + (steps + 32767) / 65534 * (high - low))

    first, second, third = (read(text) for text in channel["values"])
    assert first == pytest.approx(measured, abs=1e-4, nan_ok=True)
    assert second == pytest.approx(measured + 0.1, abs=1e-4, nan_ok=True)
    assert third == pytest.approx(np.full(4, high))  # a model that runs away stays at the end of the range
    assert np.frombuffer(base64.b64decode(drawn["t"]), "<f4") == pytest.approx(t)


def test_an_explorer_is_there_only_with_its_data() -> None:
    known = evidence("effects")
    page = compose(document("effects"), known)
    assert 'id="tracer"' not in page and "traces-data" not in page and 'id="traces-still"' in page
