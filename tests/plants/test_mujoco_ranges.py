"""A model whose ranges are narrower than its robot's is used without the ends that were passed."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from oracles.arms import CHANNELS, arm_xml, random_drive, random_start, robot_of, settings_of

import residual_mpc as rm

CLAMPED = '<position name="j1" joint="j1" kp="30" kv="1.5" {0}/><position name="j2" joint="j2" kp="20" kv="0.8"/>'


@pytest.mark.parametrize("degrees", [True, False])
def test_wider_ranges_are_those_of_a_model_that_has_them(tmp_path: Path, degrees: bool) -> None:
    """Beside a soft gear too, for which the model is compiled anew."""
    unit = 180.0 / np.pi if degrees else 1.0
    compiler = "" if degrees else '<compiler angle="radian"/>'

    def xml(joint: float, command: float) -> str:
        text = arm_xml(CLAMPED.format(f'ctrllimited="true" ctrlrange="-{command} {command}"'))
        text = text.replace('range="-90 90"', f'range="{-joint * unit} {joint * unit}"')
        return text.replace("<option", compiler + "<option").replace('euler="10 20 30"', "")

    narrow, wide = robot_of(tmp_path, xml(0.1, 0.1)), robot_of(tmp_path, xml(2.0, 1.5))
    assert narrow.clamps == {"j1": (-0.1, 0.1)} and narrow.limits["j2"] == pytest.approx((-0.1, 0.1))
    made = narrow.with_ranges({"j2": (-2.0, 2.0)}, {"j1": (-1.5, 1.5)})
    drive, start = random_drive(narrow, 2, 150, size=1.2), random_start(narrow, 2)
    soft = {("joint_compliance", "j1", "stiffness"): 40.0}
    for hypothesis in ({}, soft):
        settings = settings_of(narrow, hypothesis, hypothesis)
        came, wanted, before = (r.replay(start, drive, settings, CHANNELS) for r in (made, wide, narrow))
        for channel in CHANNELS:
            np.testing.assert_allclose(came[channel], wanted[channel], rtol=0, atol=1e-9)
        assert np.abs(came["position.j1"] - before["position.j1"]).max() > 0.1
    assert narrow.clamps == {"j1": (-0.1, 0.1)}  # and the first robot is as it was


def test_runs_beyond_the_models_range_have_no_gap(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(arm_xml(CLAMPED.format("")).replace('range="-90 90"', 'range="-20 20"'))
    (tmp_path / "robot.toml").write_text('name = "arm"\nplant = "mujoco"\nmodel = "arm.xml"\n')
    model = mujoco.MjModel.from_xml_string(arm_xml(CLAMPED.format("")))
    data, t = mujoco.MjData(model), 0.02 * np.arange(400)
    rng = np.random.default_rng(0)
    command = np.stack([0.5 * np.sin(1.1 * t), 0.9 * np.sin(1.7 * t)], axis=1)
    q = []
    for u in command:
        q.append(data.qpos.copy())
        data.ctrl[:] = u
        mujoco.mj_step(model, data, 10)
    noisy = np.array(q) + 1e-3 * rng.standard_normal((len(t), 2))
    columns = {"command.j1": command[:, 0], "command.j2": command[:, 1]}
    table = {"t": t, **columns, "position.j1": noisy[:, 0], "position.j2": noisy[:, 1]}
    pd.DataFrame(table).to_csv(tmp_path / "run.csv", index=False)
    robot = rm.load_robot(tmp_path / "robot.toml")
    runs = rm.read_runs(robot, tmp_path / "run.csv")
    assert ["beyond the range"] == [f.kind for f in runs.findings if f.severity == "warning"]
    gap = rm.measure_gap(robot, runs)
    assert gap.nominal < 2.0 * gap.noise_floor
