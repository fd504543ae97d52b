"""A reference in other units, or beyond what the robot can do, is refused or doubted before anything is built; what
robots usually follow passes in silence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml

import residual_mpc as rm
from controllers.settings import Limits, MpcSettings
from residual_mpc.cli.main import main
from residual_mpc.closed_loop.scenario import DoubtfulReference, RunOptions
from residual_mpc.errors import BadInput
from residual_mpc.export.augmented import Augmented
from scenarios.own import OwnScenario, Waypoints
from scenarios.own.reference import named_motion, read_reference
from scenarios.own.reference_audit import audit_reference, wheel_limit

SERVOS = """
<position name="j1" joint="j1" kp="120" kv="8" ctrlrange="-2 2"/>
<position name="j2" joint="j2" kp="60" kv="3" ctrlrange="-1.5 1.5"/>
"""
JOINTS, POSE = ("position.j1", "position.j2"), ("pose.x", "pose.y", "pose.theta")
T = np.linspace(0.0, 25.0, 501)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> rm.NominalRobot:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.xml").write_text(arm_xml(SERVOS))
    (folder / "arm.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\npayload_site = "tool"\n')
    return rm.load_robot(folder / "arm.toml")


@pytest.fixture(scope="module")
def arms_model(arm: rm.NominalRobot) -> Augmented:
    return rm.augment(arm, dt=0.02).augmented


@pytest.fixture(scope="module")
def rover() -> Augmented:
    return rm.augment(rm.load_robot("diff_drive"), dt=0.05).augmented


def swing(times: float = 1.0, t: np.ndarray = T) -> Waypoints:
    """Within 0.4 rad of an arm's joints."""
    return Waypoints(JOINTS, t, times * np.stack([0.4 * np.sin(T), -0.3 * np.sin(T)], axis=-1))


def eight(size: float = 1.0, turned: float = 1.0, noise: float = 0.0, t: np.ndarray = T) -> Waypoints:
    """A figure of eight, 1.2 m long, driven at 0.2 to 0.4 m/s, its heading wrapped once at most."""
    w = 0.5
    x, y = 0.6 * np.sin(w * T), 0.3 * np.sin(2 * w * T)
    theta = np.unwrap(np.arctan2(np.cos(2 * w * T), np.cos(w * T)))
    rng = np.random.default_rng(0)
    xy = size * np.stack([x, y]) + noise * rng.standard_normal((2, len(T)))
    return Waypoints(POSE, t, np.stack([*xy, turned * theta], axis=-1))


def test_what_robots_usually_follow_passes_in_silence(arms_model: Augmented, rover: Augmented) -> None:
    for name in ("sines", "postures"):
        assert audit_reference(named_motion(name, arms_model), arms_model, 0.02) == []
    assert audit_reference(swing(), arms_model, 0.02) == []
    sparse = Waypoints(JOINTS, np.arange(3.0), np.array([[0.0, 0.0], [0.4, 0.2], [0.0, 0.0]]))  # as in own-arm.md
    assert audit_reference(sparse, arms_model, 0.02) == []
    backwards = eight()
    backwards.values[:, 2] += np.pi
    corner = Waypoints(POSE, np.arange(4.0), np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1.57], [1, 1, 1.57]]))
    standing = Waypoints(POSE, np.arange(11.0), np.stack([np.zeros(11), np.zeros(11), 0.5 * np.arange(11)], axis=-1))
    for path in (eight(), eight(noise=0.003), backwards, corner, standing):
        assert audit_reference(path, rover, 0.05) == []


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (eight(1000.0), "and wheel speeds up to .* rad/s: millimetres\\? Give pose.x and pose.y in m"),
        (eight(turned=180 / np.pi), "if pose.theta is in degrees, 100% is. Give pose.theta in rad"),
        (eight(t=1e3 * T), "0 to 25000 s in steps of 50 s, 500000 samples of 0.05 s: milliseconds\\? Give t in sec"),
    ],
)
def test_a_path_in_other_units_is_refused(rover: Augmented, path: Waypoints, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        audit_reference(path, rover, 0.05)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (eight(20.0), "the path needs 8.48 m/s at "),
        (eight(100.0), "pose.x and pose.y may be in mm"),
        (eight(turned=0.0), "of the path is along pose.theta, and two wheels cannot drive sideways: pose.theta should"),
        (Waypoints(POSE, T, np.stack([0 * T, 0 * T, 30.0 * T], axis=-1)), "pose.theta turns at 30 rad/s at "),
        (eight(t=200.0 * T), "it lasts 1.4 h, 100000 samples of 0.05 s for each controller"),
    ],
)
def test_a_path_that_is_hardly_meant_is_doubted(rover: Augmented, path: Waypoints, said: str) -> None:
    if path.seconds > 3600.0:  # in dense rows a long path may well be meant
        t = np.linspace(0.0, path.seconds, 20_001)
        path = Waypoints(POSE, t, path.path(t))
    (doubt,) = audit_reference(path, rover, 0.05)
    assert said in doubt


def test_wheels_are_held_against_the_limits_that_are_known(tmp_path: Path, rover: Augmented) -> None:
    assert wheel_limit(rover) is None
    row = {"effect": "saturation", "target": None, "parameter": "limit", "value": 9.0}
    (tmp_path / "model.json").write_text(
        json.dumps({"schema": "residual-mpc/model/1", "robot": "diff_drive", "values": [row]})
    )
    limited = rm.augment(rm.load_robot("diff_drive"), tmp_path / "model.json", dt=0.05).augmented
    assert wheel_limit(limited) == 9.0
    (doubt,) = audit_reference(eight(), rover, 0.05, 9.0)
    assert doubt.startswith("the path needs wheel speeds of 1") and doubt.endswith("which are limited to 9 rad/s")


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (180 / np.pi, "position.j2 is -1.7.* rad in line 4, 0.1 s after the start, and reaches .*17.19 .*: degrees\\?"),
        (10.0, "joint's range of -?[0-9.]+ to [0-9.]+ rad. Keep the path within the range"),
    ],
)
def test_joints_far_outside_their_ranges_are_refused(
    arms_model: Augmented, tmp_path: Path, times: float, said: str
) -> None:
    path, motion = tmp_path / "path.csv", swing(times)
    rows = "\n".join(f"{t},{a},{b}" for t, (a, b) in zip(T.tolist(), motion.values.tolist(), strict=True))
    path.write_text(f"t,{','.join(JOINTS)}\n{rows}\n")
    with pytest.raises(BadInput, match=said) as caught:
        audit_reference(read_reference(path), arms_model, 0.02)
    assert caught.value.where == str(path)


def test_the_command_refuses_it_before_it_builds_a_controller(
    arm: rm.NominalRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(OwnScenario, "_stack", lambda *_: pytest.fail("built a controller"))
    (tmp_path / "path.csv").write_text(f"t,{','.join(JOINTS)}\n0,0,0\n1,0,40\n2,0,0\n")
    model = {"schema": "residual-mpc/model/1", "robot": "arm", "values": []}
    (tmp_path / "model.json").write_text(json.dumps(model))
    words = ["--robot", arm.given, "--model", tmp_path / "model.json", "--reference", tmp_path / "path.csv"]
    with pytest.raises(SystemExit) as end:
        main(["run", *map(str, words), "--seeds", "1"])
    told = capsys.readouterr()
    assert end.value.code == 2 and "position.j2 is 40 rad in line 3" in told.err and "degrees? Give" in told.err


def test_a_doubt_is_told_before_the_run_and_in_its_notes(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = rm.load_robot("diff_drive")

    class Still:
        actuators, channels = ("left", "right"), POSE

        def __init__(self, robot: Any, period: float) -> None: ...

        def start(self, rng: Any, at: Any) -> Still:
            self.at = dict(at)
            return self

        def measure(self) -> dict[str, float]:
            return self.at

        truth = measure

        def step(self, command: np.ndarray, dt: float) -> None: ...

        def close(self) -> None: ...

    for module in ("controllers.rollout", "residual_mpc.closed_loop.estimator"):
        monkeypatch.setattr(f"{module}.compiler", lambda: None)
    limits = MpcSettings(limits=Limits(lower=-2.0, upper=2.0))
    ahead = Waypoints(POSE, np.arange(3.0), np.stack([0.2 * np.arange(3.0), np.zeros(3), np.zeros(3)], axis=-1))
    scenario = OwnScenario(
        robot, rm.augment(robot, dt=0.05), ahead, plant=Still, settings=limits, controllers=("nominal",)
    )
    with pytest.warns(DoubtfulReference, match="which are limited to 2 rad/s"):
        result = scenario.run(RunOptions(seeds=1))
    assert result["notes"][0].endswith("which are limited to 2 rad/s")
