"""Stretches that are unlike everything else: found in few and short stretches, searched without, counted, named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.rover_euler import simulate
from oracles.rover_log import ROBOT, SIGMA, rover_run, write_run

import residual_mpc as rm
from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.hold_out import KeptBack
from residual_mpc.diagnosis.data.left_out import across
from residual_mpc.diagnosis.phases.validate import _unknown_starts
from residual_mpc.diagnosis.results.settings import AsideSettings
from residual_mpc.diagnosis.results.unlike_the_rest import Unlike, joined_stretches, unlike_the_rest
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Term
from residual_mpc.report.terminal import diagnosis_lines

ROVER = DiffDrive("rover", 0.033, 0.16)
SETTINGS = AsideSettings()


@pytest.fixture(scope="module")
def data() -> Dataset:
    """60 windows of three runs."""
    return build_dataset([rover_run(f"r{k}", {}, 20.0, seed=k) for k in range(3)], [ROVER] * 3, SIGMA)


def gaps(data: Dataset, size: float, *odd: tuple[str, float]) -> np.ndarray:
    """(W,) usual gaps of about 0.03, and `size` in the windows that begin in these runs at these times."""
    out = np.asarray(0.03 * np.sqrt(np.random.default_rng(0).chisquare(5.0, data.count) / 5.0))
    for run, begin in odd:
        names = np.array([data.runs[i].name for i in data.run])
        out[(names == run) & (np.abs(data.start - begin) < 0.5)] = size
    return out


def test_one_stretch_with_its_gap(data: Dataset) -> None:
    found = unlike_the_rest(data, gaps(data, 0.9, ("r1", 7.0), ("r1", 8.0), ("r1", 10.0)), SETTINGS)
    assert [(k.run, k.start, k.end) for k in found.stretches] == [("r1", pytest.approx(7.0), pytest.approx(11.0))]
    assert found.gap == pytest.approx(0.9) and 0.02 < found.usual < 0.04
    document = found.document(1.0)
    assert document is not None and str(document["note"]).startswith("r1 from 7 to 11 s is unlike everything else")
    assert Unlike().document(1.0) is None


@pytest.mark.parametrize(
    ("size", "odd"),
    [
        (0.1, [("r1", 7.0)]),  # not by far
        (0.9, [("r0", 2.0), ("r0", 9.0), ("r1", 7.0), ("r2", 3.0)]),  # in many places: this is how the robot is
        (0.9, [("r1", float(k)) for k in range(3, 12)]),  # not short
        (0.9, []),
    ],
)
def test_what_is_no_such_stretch(data: Dataset, size: float, odd: list[tuple[str, float]]) -> None:
    assert unlike_the_rest(data, gaps(data, size, *odd), SETTINGS) == Unlike()


def test_noise_that_a_window_magnifies_is_no_such_stretch(data: Dataset) -> None:
    """An arm that falls with its motors off magnifies every error of its start."""
    found = gaps(data, 0.9, ("r1", 7.0))
    floor = np.where(found > 0.5, 0.4, 0.02)
    assert unlike_the_rest(data, found, SETTINGS, floor) == Unlike()
    assert unlike_the_rest(data, found, SETTINGS, np.where(found > 0.5, 0.2, 0.02)).stretches


def test_few_windows_tell_nothing(data: Dataset) -> None:
    few = data.take(np.arange(data.count) < 15)
    assert unlike_the_rest(few, gaps(few, 0.9, ("r0", 7.0)), SETTINGS) == Unlike()


def test_stretches_that_meet_are_one() -> None:
    a, b, c = KeptBack("r0", 1.0, 3.0), KeptBack("r0", 2.0, 4.0), KeptBack("r1", 1.0, 2.0)
    assert joined_stretches((a, c), (b,)) == (KeptBack("r0", 1.0, 4.0), c)


def pushed(run: Run, begin: float) -> Run:
    """For 1.5 s the robot does something else than its log says."""
    amid = (run.t >= begin) & (run.t < begin + 1.5)
    left = np.where(amid, run.columns["command.left"] - 6.0, run.columns["command.left"])
    right = np.where(amid, run.columns["command.right"] + 6.0, run.columns["command.right"])
    return replace(run, columns={**run.columns, "command.left": left, "command.right": right})


def test_a_diagnosis_finds_the_cause_of_all_else_and_names_the_stretch(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    for k in range(5):
        run = rover_run(f"run{k}", {"track_width": {"scale": 1.1}, "wheel_radius": {"scale": 0.95}}, 16.0, seed=k)
        write_run(pushed(run, 7.0) if k == 2 else run, tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    found = rm.diagnose(robot, rm.read_runs(robot, sorted(tmp_path.glob("run*.csv")))).document
    (stretch,) = found["unlike_the_rest"]["stretches"]
    assert stretch["run"] == "run2" and stretch["from"] <= 7.0 and 8.0 <= stretch["to"] <= 10.0
    assert found["unlike_the_rest"]["note"] in found["notes"]
    assert any("unlike everything else" in line for line in diagnosis_lines(found))
    track = next(e for e in found["explanation"] if e["effect"] == "track_width")
    low, high = track["parameters"]["scale"]["ci95"]
    assert low < 1.1 < high < 1.15 and track["probability"] > 0.9


def test_fits_see_no_such_stretch(data: Dataset) -> None:
    assert data.start[across(data, (KeptBack("r1", 7.0, 9.0),))].tolist() == pytest.approx([7.0, 8.0])


def test_a_run_that_begins_with_a_stretch_has_an_unknown_past_if_none_of_it_is_held_out(data: Dataset) -> None:
    for held, expected in ((("r0", 0.0), [False, True, False]), (("r1", 1.0), [False, False, False])):
        names = np.array([data.runs[i].name for i in data.run])
        mask = (names == held[0]) & (np.abs(data.start - held[1]) < 0.5)
        of: Any = SimpleNamespace(raw=data, held=mask)
        stretches = (KeptBack("r1", 0.0, 2.0), KeptBack("r2", 5.0, 7.0))
        assert _unknown_starts(of, Unlike(stretches)).tolist() == expected


def limited(name: str, seed: int, fast: bool) -> Run:
    """A rover on a wider track whose wheels turn at 7 rad/s at most; only the fast run asks for more, for 1.2 s."""
    t = np.arange(0.0, 16.0, 0.05)
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.15, 0.7, (3, 2)), rng.uniform(0, 6.28, (3, 2))
    u = 1.9 * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1)
    u[(t >= 7.0) & (t < 8.2)] += 12.0 * fast * np.array([1.0, 0.6])

    def command(time: float) -> tuple[float, float]:
        row = u[min(int(time / 0.05 + 1e-6), len(u) - 1)]
        return float(row[0]), float(row[1])

    faults = {"track_width": {"scale": 1.1}, "saturation": {"limit": 7.0}}
    pose = simulate(command, t, faults, fine=5e-4) + rng.standard_normal((len(t), 3)) * np.array(list(SIGMA.values()))
    columns = {"command.left": u[:, 0], "command.right": u[:, 1]}
    return Run(name, t, {**columns, **{c: pose[:, k] for k, c in enumerate(SIGMA)}})


def test_an_effect_that_serves_one_stretch_alone_stays_if_the_rest_is_the_same_without_it(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    for k in range(5):
        write_run(limited(f"run{k}", k, k == 2), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    found = rm.diagnose(robot, rm.read_runs(robot, sorted(tmp_path.glob("run*.csv")))).document
    assert {e["effect"] for e in found["explanation"]} == {"track_width", "saturation"}
    assert found["unlike_the_rest"] is None


def test_what_the_rest_shows_as_well_serves_no_stretch_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The track is named without the stretch too, so that it is not said to explain nothing else."""
    stretch, terms = KeptBack("run1", 7.0, 9.0), (Term("track_width", None), Term("end_stop", "elbow"))
    monkeypatch.setattr("residual_mpc.diagnosis.diagnose.unlike_in_fits", lambda *_: ((stretch,), terms))
    (tmp_path / "robot.toml").write_text(ROBOT)
    for k in range(3):
        write_run(rover_run(f"run{k}", {"track_width": {"scale": 1.1}}, 16.0, seed=k), tmp_path)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, sorted(tmp_path.glob("run*.csv")))
    found = rm.diagnose(robot, runs, only=("track_width", "wheel_radius")).document
    assert [e["effect"] for e in found["explanation"]] == ["track_width"]
    assert "end_stop [elbow] would explain it, and nothing else" in found["unlike_the_rest"]["note"]
    assert "track_width" not in found["unlike_the_rest"]["note"]


def test_what_would_explain_a_stretch_and_nothing_else_is_told() -> None:
    found = Unlike((KeptBack("r1", 7.0, 9.0),), 0.9, 0.03, (Term("end_stop", "elbow"),))
    document = found.document(1.0)
    assert document is not None
    assert str(document["note"]).endswith("those of all else. end_stop [elbow] would explain it, and nothing else.")
