"""Pictures that fail lose neither the answer nor the rest of the report."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from fabricated_diagnosis import document, evidence

from residual_mpc.api import diagnosis as api
from residual_mpc.api.diagnosis_files import UNFINISHED
from residual_mpc.report import Evidence, compose
from residual_mpc.report.evidence.evidence import Clip
from residual_mpc.report.motion import animation

CLIP = Clip(("largest gap",), "run3", 12.0, 0.3, 0.03, np.zeros((2, 8, 8, 3), np.uint8), 1, 1.0, ("position.j2",))


def no_encoder(clip: Clip) -> bytes:
    raise OSError("encoder webp not available")


def found(verdict: str = "effects") -> api.Diagnosis:
    """A finished diagnosis of which only the report is still to be written."""
    robot = SimpleNamespace(file=SimpleNamespace(source=""), given="rover", model=SimpleNamespace(nominal=dict))
    whole = {"model": {"values": []}, "notes": [], "next_experiment": None} | document(verdict)
    return api.Diagnosis(robot, whole, SimpleNamespace(), None, ())


def test_a_clip_that_cannot_be_encoded_leaves_the_rest_of_the_page(monkeypatch):
    shown = evidence("effects")
    with_clip = Evidence(shown.panels, shown.windows, shown.starts, (CLIP,), "Seen from above.")
    assert "data:image/webp" in compose(document("effects"), with_clip)
    monkeypatch.setattr(animation, "moving", no_encoder)
    page = compose(document("effects"), with_clip)
    assert "The motion could not be shown (OSError: encoder webp not available)." in page
    assert "data:image/webp" not in page and "position.j2" not in page
    assert 'id="gap"' in page and 'id="traces"' in page


def test_the_answer_is_on_disk_before_anything_is_drawn(monkeypatch, tmp_path):
    def at_drawing(made):
        raise SystemExit("killed while drawing")

    monkeypatch.setattr(api, "collect", at_drawing)
    (tmp_path / "report.html").write_text("of an earlier diagnosis")
    with pytest.raises(SystemExit):
        found().save(tmp_path)
    written = json.loads((tmp_path / "diagnosis.json").read_text())
    assert written["verdict"] == "effects" and UNFINISHED in written["notes"]
    assert (tmp_path / "model.json").exists() and not (tmp_path / "report.html").exists()


def test_a_saved_diagnosis_says_nothing_of_being_unfinished(monkeypatch, tmp_path):
    monkeypatch.setattr(api, "collect", lambda made: evidence("effects"))
    found().save(tmp_path)
    assert UNFINISHED not in (tmp_path / "diagnosis.json").read_text()
    assert (tmp_path / "report.html").exists()
