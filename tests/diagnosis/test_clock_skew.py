"""A localisation whose clock runs at another rate, on rovers of another simulation that are stamped anew."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.arms import DT, arm_xml, robot_of
from oracles.rover_log import rover_run

from plants.diff_drive import DiffDrive
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.subsampling import shorten
from residual_mpc.diagnosis.diagnose import diagnose
from residual_mpc.diagnosis.options import Options
from residual_mpc.diagnosis.predict.candidates import build_space
from residual_mpc.diagnosis.predict.longer_steps import with_longer_steps
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.records import Diagnosis
from residual_mpc.logs.run import Run
from residual_mpc.models.settings import Knob, assemble

ROBOT = DiffDrive("rover", 0.033, 0.16)
RATE, DELAY, SECONDS = 0.0015, 0.06, 40.0  # 1, s, s
SIGMA = {"pose.x": 0.001, "pose.y": 0.001, "pose.theta": 0.002}  # m, m, rad


def stamped_run(seed: int, rate: float, delay: float = 0.0, seconds: float = SECONDS) -> Run:
    """A rover at 40 Hz with encoders. What its localisation measures at t is stamped by a clock of its own and late.
    The log has a row for each message: poses and commands stand in different ones."""
    rng = np.random.default_rng([seed, 7])
    run = rover_run(f"r{seed}", {}, seconds + 1.0, 40.0, seed=seed, noise=0.0)
    sent = run.t[run.t <= seconds]
    stamp = np.round(sent * (1.0 + rate) + delay, 6) + 1e-4
    stamp = stamp[stamp <= seconds]
    t = np.unique(np.concatenate([sent, stamp]))
    columns = {}
    for wheel in ("left", "right"):  # read before the command of the stamp acts
        u = run.columns[f"command.{wheel}"]
        seen = np.concatenate([u[:1], u[:-1]]) + 0.01 * rng.standard_normal(len(u))
        columns |= {f"command.{wheel}": at(t, sent, u), f"velocity.{wheel}": at(t, sent, seen)}
    for c, sigma in SIGMA.items():
        columns[c] = at(t, stamp, run.columns[c] + sigma * rng.standard_normal(len(run.t)))
    return Run(run.name, t, columns)


def at(t: np.ndarray, stamps: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n,) the values at their stamps, missing elsewhere."""
    out = np.full(len(t), np.nan)
    out[np.searchsorted(t, stamps)] = y[: len(stamps)]
    return out


def diagnosed(runs: list[Run]) -> Diagnosis:
    return diagnose(runs, [ROBOT] * len(runs), {}, (), Options(), np.random.default_rng(0)).diagnosis


@pytest.mark.slow
@pytest.mark.parametrize("rate", [RATE, -RATE])
def test_the_rate_is_recovered(rate: float) -> None:
    found = diagnosed([stamped_run(k, rate) for k in range(3)])
    (cause,) = found.causes
    assert (cause.term.effect, cause.term.target, found.verdict) == ("clock_skew", "pose", "effects")
    (number,) = cause.parameters
    assert number.ci95[0] <= rate <= number.ci95[1] and abs(number.value - rate) < 0.1 * RATE


@pytest.mark.slow
def test_a_delay_and_a_skew_are_found_together() -> None:
    found = diagnosed([stamped_run(k, RATE, DELAY) for k in range(3)])
    numbers = {c.term.effect: c.parameters[0] for c in found.causes}
    assert set(numbers) == {"sensor_delay", "clock_skew"} and found.verdict == "effects"
    assert abs(numbers["sensor_delay"].value - DELAY) < 0.003
    assert abs(numbers["clock_skew"].value - RATE) < 0.1 * RATE


@pytest.mark.slow
def test_a_delay_alone_is_no_skew() -> None:
    found = diagnosed([stamped_run(k, 0.0, DELAY) for k in range(3)])
    (cause,) = found.causes
    assert cause.term.effect == "sensor_delay" and found.verdict == "effects"


@pytest.mark.slow
def test_clocks_that_agree_have_none() -> None:
    assert diagnosed([stamped_run(k, 0.0) for k in range(3)]).verdict == "no_gap"


@pytest.mark.parametrize("rate", [0.01, -0.01])
def test_one_clock_stamps_all_encoders_of_an_arm(rate: float, tmp_path: Path) -> None:
    """Servos of MuJoCo, stepped one by one; windows of the usual steps and of longer ones."""
    robot = robot_of(tmp_path, arm_xml())
    model = mujoco.MjModel.from_xml_string(arm_xml())
    state = mujoco.MjData(model)
    t, fine = 0.02 * np.arange(601), DT * np.arange(6201)
    u = 0.5 * np.sin(np.outer(t, [3.0, 4.1])) + 0.2 * np.sign(np.sin(np.outer(t, [1.3, 0.9])))
    q = np.empty((len(fine), 2))
    for k in range(len(fine)):
        q[k] = state.qpos
        state.ctrl[:] = u[min(k // 10, len(u) - 1)]
        mujoco.mj_step(model, state)
    columns = {f"command.j{j + 1}": u[:, j] for j in (0, 1)}
    columns |= {f"position.j{j + 1}": np.interp(t / (1.0 + rate), fine, q[:, j]) for j in (0, 1)}
    whole = build_dataset([Run("arm", t, columns)], [robot], {})
    whole = whole.take((whole.start > 0.5) & (whole.start < 10.5))
    slots = {"clock_skew": robot.slots("clock_skew")}
    assert slots["clock_skew"] == ("sensors",)

    def error(data: Dataset, value: float) -> float:
        row = assemble([{Knob("clock_skew", None, "rate"): value}], slots)
        return float(np.sqrt(np.nanmean((data.y - predict(data, row)[0]) ** 2)))

    longer = with_longer_steps(whole, 2)
    assert longer is not None
    for data in (whole, shorten(whole, 0.5), longer):
        assert error(data, rate) < 0.1 * error(data, 0.0)
        assert min(error(data, 0.8 * rate), error(data, 1.2 * rate)) > 1.5 * error(data, rate)


def test_short_runs_do_not_show_it() -> None:
    data = build_dataset([stamped_run(0, RATE, seconds=8.0)], [ROBOT], SIGMA)
    space = build_space(data, ())
    assert [t for t in space.ruled_out if t.effect == "clock_skew"]
    assert not [t for t in space.candidates if t.effect == "clock_skew"]
