"""What was sent before a log began: setpoints that still act, and runs of which nobody knows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from oracles.arms import arm_xml, robot_of, settings_of

from plants.diff_drive import DiffDrive
from plants.mujoco_robot.robot import MujocoRobot
from residual_mpc.diagnosis.data.dataset import Dataset, build_dataset
from residual_mpc.diagnosis.data.gap import measure_scales, per_window
from residual_mpc.diagnosis.data.reached_setpoints import reached
from residual_mpc.diagnosis.data.settings import UnknownPastSettings
from residual_mpc.diagnosis.data.signals import Signal, Signals
from residual_mpc.diagnosis.data.unknown_past import after_unknown_past, has_memory, runs_with_unknown_past
from residual_mpc.diagnosis.predict.replay import predict
from residual_mpc.diagnosis.results.conditions import notes
from residual_mpc.diagnosis.results.gaps import _look
from residual_mpc.diagnosis.results.settings import ResultSettings
from residual_mpc.diagnosis.results.verdict import judged_share, verdict_of
from residual_mpc.logs.run import Run
from residual_mpc.models import optional
from residual_mpc.models.facts import facts_of
from residual_mpc.models.settings import Knob, assemble
from residual_mpc.models.targets import Targets

MASS, ARM, STIFF, DAMPED, LAG = 0.8, 0.25, 40.0, 2.0, 0.06  # kg, m, N m/rad, N m s/rad, s
INERTIA, GRAVITY = MASS * ARM**2 + 1e-3, 9.81
FINE, PERIOD, SIGMA = 1e-4, 0.01, 2e-5  # s, s, rad
SERVO = f'<position name="hub" joint="hub" kp="{STIFF}" kv="{DAMPED}"/>'
MOTOR = '<motor name="hub" joint="hub"/>'


def robot(folder: Path, actuator: str = SERVO) -> MujocoRobot:
    """A link that hangs from a hinge, horizontal at zero."""
    return robot_of(
        folder,
        f"""<mujoco model="link"><option timestep="0.002" integrator="implicitfast"><flag contact="disable"/></option>
        <worldbody><body name="arm"><joint name="hub" type="hinge" axis="0 -1 0"/>
        <inertial pos="{ARM} 0 0" mass="{MASS}" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody>
        <actuator>{actuator}</actuator></mujoco>""",
    )


def sagging_run(before: float = 2.0, torque: bool = False, seed: int = 0) -> Run:
    """Explicit Euler steps of 0.1 ms; the servo's setpoint trails a smooth command, or the command is the torque that
    the servo gives. The log begins `before` s after the start from rest; the command begins to move after 1.5 s."""
    every, n = round(PERIOD / FINE), round(12.0 / PERIOD)
    t = PERIOD * np.arange(n)
    moved = np.clip(t - 1.5, 0.0, None)
    sent = 0.4 + 0.5 * np.sin(2.1 * moved) * moved / (1.0 + moved)
    q, w, setpoint, rows = 0.4, 0.0, 0.4, []
    for _ in range(2000):  # where it rests under the first command
        q = 0.4 - MASS * GRAVITY * ARM * np.cos(q) / STIFF
    for k in range(n):
        force = STIFF * (setpoint - q) - DAMPED * w
        rows.append((force if torque else sent[k], q))
        for _ in range(every):
            setpoint += FINE * (sent[k] - setpoint) / LAG
            force = force if torque else STIFF * (setpoint - q) - DAMPED * w
            w += FINE * (force - MASS * GRAVITY * ARM * np.cos(q)) / INERTIA
            q += FINE * w
    command, position = np.array(rows)[t >= before].T
    noise = SIGMA * np.random.default_rng(seed).standard_normal(len(position))
    return Run(f"r{seed}", t[t >= before], {"command.hub": command, "position.hub": position + noise})


def unknown(data: Dataset) -> list[bool]:
    return list(runs_with_unknown_past(data, UnknownPastSettings()))


def test_a_servo_that_hangs_below_its_command_begins_at_the_command(tmp_path: Path) -> None:
    """Its measured angle is no setpoint: the difference is what holds the load."""
    link = robot(tmp_path)
    data = build_dataset([sagging_run(0.0)], [link], {})
    lag = {Knob("actuator_lag", "hub", "time_constant"): LAG}
    error = data.y - predict(data, assemble([lag], Targets(link)))[0]
    size = np.sqrt(per_window(data, measure_scales(data), error))
    assert data.start[0] == 0.0
    assert size[0] < 2.0 * np.median(size) < 0.01


def test_setpoints_hold_the_load(tmp_path: Path) -> None:
    link, q, v = robot(tmp_path), np.array([0.3, -1.0]), np.array([0.0, 2.0])
    found = optional.steady_setpoints(link, {"position.hub": q, "velocity.hub": v})
    load = MASS * GRAVITY * ARM * np.cos(q)
    assert found[:, 0] == pytest.approx(q + (DAMPED * v + load) / STIFF)


@pytest.mark.parametrize(("stays", "before"), [(True, 0.9), (False, 0.354)])
def test_a_joint_that_rests_far_from_its_command_holds_it(tmp_path: Path, stays: bool, before: float) -> None:
    """A servo that is far softer than its model says: what the model would need to stand there is not what was held."""
    run = sagging_run(0.0)
    sent = run.columns["command.hub"] + 0.5 + (0.0 if stays else np.where(run.t > 0.1, 0.05, 0.0))
    softer = replace(run, columns={**run.columns, "command.hub": sent})
    drive = build_dataset([softer], [robot(tmp_path)], {}).blocks[0].drive
    assert drive.command[0, drive.lead - 1, 0] == pytest.approx(before, abs=2e-3)


def test_a_command_that_jumps_as_the_log_begins_is_not_what_was_held(tmp_path: Path) -> None:
    run = sagging_run(0.0)
    sent = run.columns["command.hub"] + 0.5 + 0.2 * run.t
    jumped = replace(run, columns={**run.columns, "command.hub": sent})
    drive = build_dataset([jumped], [robot(tmp_path)], {}).blocks[0].drive
    rests_at = run.columns["position.hub"][0]  # but for the noise of its speed
    assert drive.command[0, drive.lead - 1, 0] == pytest.approx(rests_at, abs=5e-4)
    assert drive.command[0, drive.lead, 0] == pytest.approx(0.9)


@pytest.mark.parametrize(("begins", "wanted"), [(0.0, False), (4.0, True)])
def test_a_servo_that_moves_as_the_log_begins_has_an_unknown_past(tmp_path: Path, begins: float, wanted: bool) -> None:
    assert unknown(build_dataset([sagging_run(begins)], [robot(tmp_path)], {})) == [wanted]


def test_a_motor_that_held_a_load_before_the_log_has_an_unknown_past(tmp_path: Path) -> None:
    """It stands still, but with torques that no command tells."""
    assert unknown(build_dataset([sagging_run(0.0, torque=True)], [robot(tmp_path, MOTOR)], {})) == [True]


def test_the_first_windows_are_left_out_unless_they_are_many(tmp_path: Path) -> None:
    link = robot(tmp_path)
    runs = [sagging_run(0.0, seed=0), sagging_run(4.0, seed=1)]
    data = build_dataset(runs, [link] * 2, {})
    settings, every = UnknownPastSettings(), np.ones(data.count, dtype=bool)
    free = after_unknown_past(data, every, np.array([False, True]), settings)
    assert list(zip(data.run[~free], data.start[~free], strict=True)) == [(1, 4.0)]
    assert after_unknown_past(data, every, np.array([True, True]), replace(settings, most=0.05)).all()
    first = data.start == data.start[data.run == 0][0]
    only = (data.run == 0) & first  # all others are held out
    assert (after_unknown_past(data, only, np.array([True, True]), settings) == only).all()


def test_what_an_unknown_past_spoils_counts_in_the_gap_and_not_in_the_verdict(tmp_path: Path) -> None:
    link = robot(tmp_path)
    data = build_dataset([sagging_run(0.0, seed=0), sagging_run(4.0, seed=1)], [link] * 2, {})
    early = (data.run == 1) & (data.start == 4.0)
    error = np.where(early, 0.14, 0.0)[:, None, None] * np.ones_like(data.y)
    floor: Any = SimpleNamespace(total=0.01, channels=np.array([0.01]))
    every = np.ones(data.count, dtype=bool)
    errors = dict.fromkeys(("nominal", "before", "after"), error)
    spoilt, whole = (
        _look(data, measure_scales(data), errors, every, False, floor, unknown, ResultSettings())
        for unknown in (np.array([False, True]), np.array([False, False]))
    )
    assert spoilt.after.total == whole.after.total == whole.steady.total > 0.1  # no window counts as diverged
    assert spoilt.steady.total == 0.0 and (spoilt.unjudged, whole.unjudged) == (1, 0)
    assert (verdict_of([spoilt]), verdict_of([whole])) == ("effects", "partial")
    assert judged_share(spoilt) == 0.0 < judged_share(whole)


def test_a_horizon_whose_windows_all_begin_after_an_unknown_past_does_not_decide(tmp_path: Path) -> None:
    """Unless it is the headline's, which is the first."""
    data = build_dataset([sagging_run(4.0)], [robot(tmp_path)], {}).take(np.array([True] + [False] * 7))
    error = 0.14 * np.ones_like(data.y)
    floor: Any = SimpleNamespace(total=0.01, channels=np.array([0.01]))
    errors = dict.fromkeys(("nominal", "before", "after"), error)
    early, known = (
        _look(data, measure_scales(data), errors, np.array([True]), False, floor, np.array([past]), ResultSettings())
        for past in (True, False)
    )
    assert not early.decides and known.decides and early.steady.total == known.steady.total > 0.0
    right = replace(known, steady=replace(known.steady, total=0.0, channels=np.zeros(1)))
    assert verdict_of([right, early]) == "effects" and verdict_of([right, known]) == "partial"
    assert verdict_of([early, right]) == "partial"


@pytest.mark.parametrize(
    ("effect", "parameter", "target", "wanted"),
    [
        ("viscous_friction", "coefficient", "hub", False), ("joint_spring", "stiffness", "hub", False),
        ("payload", "mass", None, False), ("actuator_gain", "gain", "hub", False),
        ("actuator_lag", "time_constant", "hub", True), ("backlash", "gap", "hub", True),
        ("servo_integral", "gain", "hub", True), ("joint_compliance", "stiffness", "hub", True),
        ("sensor_delay", "delay", None, True), ("sensor_lag", "time_constant", None, True),
    ],
)  # fmt: skip
def test_the_past_acts_through_effects_with_a_memory_alone(
    tmp_path: Path, effect: str, parameter: str, target: str | None, wanted: bool
) -> None:
    row = settings_of(robot(tmp_path), {(effect, target, parameter): 0.5})
    assert has_memory(row) == wanted


def test_notes_say_which_windows_the_verdict_leaves_out(tmp_path: Path) -> None:
    data = build_dataset([sagging_run(0.0, seed=0), sagging_run(4.0, seed=1)], [robot(tmp_path)] * 2, {})
    floor: Any = SimpleNamespace(total=0.01, channels=np.array([0.01]))
    errors = dict.fromkeys(("nominal", "before", "after"), np.zeros_like(data.y))
    every = np.ones(data.count, dtype=bool)
    look = _look(data, measure_scales(data), errors, every, False, floor, np.array([False, True]), ResultSettings())
    found: Any = SimpleNamespace(
        looks=(look,), helps=True, useless=False, stepping=False, step_error=None, constant_velocity=1.0,
        left=look.after,
    )  # fmt: skip
    of: Any = SimpleNamespace(
        doubtful=(), vetoed=(), in_parts={}, unlikely={}, run_sizes={}, untestable=(), held=every, raw=data,
        with_outliers=False,
        outliers=SimpleNamespace(count=0),
        final=SimpleNamespace(knobs=(), held=(), terms=(), values={}),
    )  # fmt: skip
    (said, _) = notes(of, found, None, None, ResultSettings())
    assert said.startswith("1 window of 1 s begins at the start of a run that is already in motion, under load or")
    assert said.endswith("It counts in the gap, and not in the verdict.")
    nothing: Any = SimpleNamespace(**{**vars(found), "looks": (replace(look, unjudged=look.windows),)})
    assert len(notes(of, nothing, None, None, ResultSettings())) == 1  # the headline's horizon decides all the same


def test_a_gear_turns_the_setpoint_into_units_of_the_command(tmp_path: Path) -> None:
    geared = robot(tmp_path, SERVO.replace("/>", ' gear="2"/>'))
    q, v = np.array([0.3]), np.array([1.5])
    found = optional.steady_setpoints(geared, {"position.hub": q, "velocity.hub": v})
    load = MASS * GRAVITY * ARM * np.cos(q)
    assert found[:, 0] == pytest.approx(2.0 * q + (2.0 * DAMPED * v + 0.5 * load) / STIFF)


@pytest.mark.parametrize(("gear", "lag"), [(1.0, DAMPED / STIFF), (-2.0, DAMPED / STIFF)])
def test_the_audit_knows_the_lag_of_the_model_s_own_servo(tmp_path: Path, gear: float, lag: float) -> None:
    """Damping over gain, whatever the load and the gear; a torque motor has none."""
    geared = robot(tmp_path, SERVO.replace("/>", f' gear="{gear}"/>'))
    assert [a.lag for a in facts_of(geared).actuators] == [pytest.approx(lag, rel=1e-6)]
    assert facts_of(robot(tmp_path, MOTOR)).actuators[0].lag is None


def test_variants_have_no_setpoint_of_their_own(tmp_path: Path) -> None:
    places = [tmp_path / name for name in ("soft", "stiff")]
    for place in places:
        place.mkdir()
    soft, stiff = robot(places[0]), robot(places[1], SERVO.replace(str(STIFF), "80.0"))
    merged = soft.merged([stiff])
    assert merged is not None
    assert np.isnan(optional.steady_setpoints(merged, {"position.hub": np.zeros(3)})).tolist() == [[True]] * 3


def test_a_joint_that_nobody_measures_shows_no_setpoint(tmp_path: Path) -> None:
    """The other joint's is still known, with the unmeasured one at rest."""
    two = robot_of(tmp_path, arm_xml())
    run = sagging_run(0.0)
    signals = Signals({(0, "position.j1"): Signal(run.t, run.columns["position.hub"])})
    found = reached(two, 0, run.t[:2], signals)
    assert np.isfinite(found[:, 0]).all() and np.isnan(found[:, 1]).all()


@pytest.mark.parametrize(("moves", "period", "doubted"), [(True, 0.2, True), (False, 0.2, False), (True, 0.1, False)])
def test_a_slow_sensor_does_not_tell_motion_from_setting_off(moves: bool, period: float, doubted: bool) -> None:
    """Its second reading comes after whatever acts late; with three within a start state's reach the rate is known."""
    t = period * np.arange(60)
    x = (0.3 * t**2 if moves else 0.0 * t) + 0.001 * np.random.default_rng(0).standard_normal(len(t))
    pose = {"pose.x": x, "pose.y": 0.0 * t, "pose.theta": 0.0 * t}
    sent = {"command.left": 10.0 * t, "command.right": 10.0 * t}
    data = build_dataset([Run("r", t, {**sent, **pose})], [DiffDrive("rover", 0.05, 0.2)], {})
    assert unknown(data) == [doubted]
