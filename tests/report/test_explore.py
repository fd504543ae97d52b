"""Sliders in the report: the replays are those of the model, and the page allows this script and no other."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_log import ROBOT, rover_run
from report.filmed import filmed

import residual_mpc as rm
from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import Cause, DiagnosisResult, Estimate
from residual_mpc.effects.laws import LISTED, curve_shape
from residual_mpc.effects.library import LIBRARY
from residual_mpc.models.settings import Knob, Term, assemble
from residual_mpc.report.evidence.evidence import Evidence
from residual_mpc.report.evidence.explore import VALUES, explore, slider_values
from residual_mpc.report.report import compose
from residual_mpc.report.sections import explore as section
from residual_mpc.report.words.numbers import measure_each

ROVER = DiffDrive("rover", 0.033, 0.16)
KNOB = Knob("track_width", None, "scale")
ESTIMATE = Estimate("scale", 1.1, (1.08, 1.13), "1")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> DiagnosisResult:
    path = tmp_path_factory.mktemp("rover") / "robot.toml"
    path.write_text(ROBOT)
    robot = rm.load_robot(path).model
    found = filmed(rover_run("run1", {"track_width": {"scale": 1.1}}, 8.0), robot, {KNOB: 1.1})
    named: Any = found.diagnosis
    cause = Cause(Term("track_width", None), 0.97, (ESTIMATE,), "")
    shares = tuple((c, 1.0 / 3) for c in found.data.channels)
    named.__dict__.update(causes=(cause,), where=SimpleNamespace(channels=shares))
    return found


def test_a_slider_runs_through_the_interval_and_beyond() -> None:
    values = slider_values(KNOB, ESTIMATE, [ROVER])
    assert len(values) == VALUES and values[VALUES // 2] == 1.1 and (np.diff(values) > 0).all()
    assert values[0] == pytest.approx(1.06) and values[-1] == pytest.approx(1.16)


def test_a_slider_stays_within_what_is_possible() -> None:
    """A lag is never negative, however wide its interval."""
    knob = Knob("actuator_lag", None, "time_constant")
    values = slider_values(knob, Estimate("time_constant", 0.01, (0.001, 0.02), "s"), [ROVER])
    assert values[0] == 0.0


def test_a_slider_does_not_take_away_more_friction_than_the_model_has() -> None:
    """Of any of the robots, which differ by their variants."""
    knob, estimate = (
        Knob("viscous_friction", "j1", "coefficient"),
        Estimate("coefficient", 0.1, (-0.2, 0.2), "N m s/rad"),
    )
    robots: list[Any] = [SimpleNamespace(bounds=lambda *_, low=low: (low, np.inf)) for low in (-0.3, -0.05)]
    values = slider_values(knob, estimate, robots)
    assert values[0] == -0.05 and values[VALUES // 2] == 0.1 and (np.diff(values) > 0).all()
    assert slider_values(knob, estimate, robots[:1])[0] == -0.3


def test_the_labels_of_a_slider_differ() -> None:
    assert measure_each([1.031, 1.0345, 1.0382], "1") == ["1.031", "1.034", "1.038"]
    assert measure_each([0.01, 0.01, 0.02], "s") == [f"{v}\N{NO-BREAK SPACE}ms" for v in (10, 10, 20)]


def test_the_curves_are_replays_of_the_model_with_these_values(made: DiagnosisResult) -> None:
    found = explore(made)
    assert found is not None
    (slider,) = found.sliders
    assert int(np.argmin(slider.gaps)) == VALUES // 2  # the true value is the fitted one
    view = found.views[0]
    robot = made.data.blocks[0].robot
    one = assemble([{KNOB: float(slider.values[0])}], {e.name: robot.slots(e.name) for e in LIBRARY})
    window = next(w for w in range(made.data.count) if made.data.start[w] == view.start)
    assert made.held[window]
    predicted = predict(made.data, one)[0, window]
    for look in view.looks:
        k = made.data.channels.index(look.channel)
        rows = np.searchsorted(made.data.t[window], look.t)
        assert look.curves[0, 0] == pytest.approx(predicted[rows, k])


def test_nothing_to_explore_where_nothing_is_named(made: DiagnosisResult) -> None:
    bare: Any = SimpleNamespace(**{**made.diagnosis.__dict__, "causes": ()})
    whole = DiagnosisResult(bare, made.data, made.scales, made.before, made.after, made.held, {})
    assert explore(whole) is None


def test_the_page_allows_its_own_script_alone(made: DiagnosisResult) -> None:
    evidence = Evidence(exploration=explore(made))
    text = compose({"robot": "rover", "gap": {"horizon": 1.0}, "explanation": []}, evidence, (section.explore,))
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    assert policy.split("; ")[-1] == f"script-src 'sha256-{digest}'" and policy.startswith("default-src 'none'")
    assert "explore-data" in script and "traces-data" not in script  # the parts that this page needs
    assert "http:" not in text and "https:" not in text and "innerHTML" not in text
    (data,) = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', text, re.DOTALL)
    drawn = json.loads(data)
    assert len(drawn["sliders"][0]["labels"]) == VALUES and drawn["views"][0]["looks"]
    assert len(text) < 1_000_000
    assert text.count("<td") == VALUES  # without scripts: the gap for each value


def test_a_fitted_law_stays_as_it_is_under_the_sliders(made: DiagnosisResult) -> None:
    kind = LISTED["fitted_law_rate_turning"]
    law = {**curve_shape([-1.0, 1.0]), "start": -0.3, "rise2": 0.6}
    values = {**made.diagnosis.values, **{Knob(kind.name, "yaw", name): v for name, v in law.items()}}
    bent: Any = SimpleNamespace(**{**made.diagnosis.__dict__, "values": values})
    found = explore(DiagnosisResult(bent, made.data, made.scales, made.before, made.after, made.held, {}))
    plain = explore(made)
    assert found is not None and plain is not None
    assert [s.term for s in found.sliders] == [s.term for s in plain.sliders]
    assert found.sliders[0].gaps.min() > 2.0 * plain.sliders[0].gaps.min()  # the law is in the replays
