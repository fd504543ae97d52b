"""The audit finds planted faults, and is silent where there are none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from run_tables import ARM, WHEELS, arm_run, wheel_run

from residual_mpc.logs.audit import ActuatorFacts, RobotFacts, audit
from residual_mpc.logs.audit.jumps import check_jumps
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.readers.read import read_runs
from residual_mpc.logs.run import FloatArray, Run
from residual_mpc.models.robot_file import read_robot_file

STUCK = {"stuck sensor", "frozen sensor", "standing", "step", "carried"}
RECORDED = Path(__file__).parents[3] / "shared" / "data"
Columns = dict[str, FloatArray]
Fault = Callable[[Columns], None]


def arms(seed: int = 0) -> list[Run]:
    rng = np.random.default_rng(seed)
    return [arm_run(rng, f"run{k}") for k in range(3)]


def wheels(seed: int = 0) -> list[Run]:
    rng = np.random.default_rng(seed)
    return [wheel_run(rng, f"run{k}") for k in range(3)]


def with_fault(runs: Sequence[Run], fault: Fault) -> list[Run]:
    broken = []
    for run in runs:
        columns = {name: values.copy() for name, values in run.columns.items()}
        fault(columns)
        broken.append(replace(run, columns=columns))
    return broken


def scaled(factor: float, *names: str) -> Fault:
    def fault(columns: Columns) -> None:
        for name in names:
            columns[name] *= factor

    return fault


def swapped(a: str, b: str) -> Fault:
    def fault(columns: Columns) -> None:
        columns[a], columns[b] = columns[b], columns[a]

    return fault


def without_encoders(of: Fault) -> Fault:
    def fault(columns: Columns) -> None:
        of(columns)
        for wheel in ("left", "right"):
            columns.pop(f"velocity.{wheel}", None)

    return fault


def frozen(begin: int, end: int) -> Fault:
    def fault(columns: Columns) -> None:
        for name in columns:
            if not name.startswith("command."):
                columns[name][begin:end] = columns[name][begin]

    return fault


def wrapped(name: str, turn: float) -> Fault:
    def fault(columns: Columns) -> None:
        columns[name] = columns[name] * turn / (2.0 * np.pi) % turn

    return fault


def late(name: str, samples: int) -> Fault:
    def fault(columns: Columns) -> None:
        columns[name] = np.concatenate([np.full(samples, columns[name][0]), columns[name][:-samples]])

    return fault


def both(*faults: Fault) -> Fault:
    def fault(columns: Columns) -> None:
        for one in faults:
            one(columns)

    return fault


def kinds(findings: Sequence[Finding], *severities: str) -> set[tuple[str, str]]:
    return {(f.kind, f.column) for f in findings if f.severity in (severities or ("error", "warning"))}


@pytest.mark.parametrize("seed", range(5))
def test_it_is_silent_about_sound_runs(seed: int) -> None:
    assert kinds(audit(arms(seed), ARM)) == set()
    assert kinds(audit(wheels(seed), WHEELS)) == set()


def test_a_delay_is_no_fault() -> None:
    findings = audit(arms(), ARM)
    assert {f.kind for f in findings} == {"late answer"}
    found = [float(f.message.split("about ")[1].split(" ms")[0]) for f in findings]
    np.testing.assert_allclose(found, 60.0, atol=10.0)
    assert all(f.message.endswith("(delay, lag and inertia combined)") for f in findings)
    known = replace(ARM, actuators=tuple(replace(a, lag=0.045) for a in ARM.actuators))
    said = "(the modelled servo alone lags by 45 ms in steady motion)"
    assert all(f.message.endswith(said) for f in audit(arms(), known))


DEG = 180.0 / np.pi


@pytest.mark.parametrize("gear", [-1.0, 50.0, -9.5])
def test_a_servos_command_is_compared_over_its_gear(gear: float) -> None:
    """The command of such a servo is what its motor turns by: the same columns without the gear are a fault."""
    geared = replace(ARM, actuators=(replace(ARM.actuators[0], gear=gear), *ARM.actuators[1:]))
    runs = arms()
    for run in runs:
        run.columns["command.a"][:] *= gear
    assert kinds(audit(runs, geared)) == set()
    if gear < 0.0:
        assert ("sign", "position.a") in kinds(audit(arms(), geared))
    for run in runs:
        run.columns["position.a"][:] *= DEG
        run.columns["velocity.a"][:] *= DEG
    assert ("degrees", "position.a") in kinds(audit(runs, geared), "error")


@pytest.mark.parametrize(
    ("fault", "severity", "kind", "column"),
    [
        (scaled(DEG, "position.a"), "error", "degrees", "position.a"),
        (scaled(DEG, "command.b"), "error", "degrees", "command.b"),
        (scaled(DEG, "velocity.c"), "error", "degrees", "velocity.c"),
        (scaled(DEG, "position.a", "velocity.a", "command.a"), "error", "degrees", "position.a"),
        (scaled(-1.0, "position.a", "velocity.a"), "error", "sign", "position.a"),
        (scaled(-1.0, "velocity.b"), "error", "sign", "velocity.b"),
        (scaled(1.3, "velocity.b"), "warning", "velocity scale", "velocity.b"),
        (swapped("position.a", "position.b"), "error", "swapped channels", "position.a"),
        (
            both(swapped("position.a", "position.c"), swapped("velocity.a", "velocity.c")),
            "error",
            "swapped channels",
            "position.a",
        ),
        (wrapped("position.a", 2.0 * np.pi), "warning", "wrapped angle", "position.a"),
        (wrapped("position.a", 360.0), "error", "degrees", "position.a"),
        (late("velocity.a", 5), "info", "channels out of step", "velocity.a"),
        (late("command.a", 10), "warning", "answer before command", "position.a"),
        (lambda c: c.update({"position.a": np.full(1000, 0.3)}), "warning", "stuck sensor", "position.a"),
        (lambda c: c.update({"position.d": c.pop("position.a")}), "warning", "unknown channel", "position.d"),
        (lambda c: c.update({"command.d": c.pop("command.a")}), "warning", "missing command", "command.a"),
        (lambda c: c.update({"velocity.a": np.full(1000, np.nan)}), "info", "empty column", "velocity.a"),
        (lambda c: c["position.a"].__setitem__(slice(50, 950, 60), 1.9), "warning", "spikes", "position.a"),
        (lambda c: c.update({"position.a": np.repeat(c["position.a"][::4], 4)}), "info", "slow sensor", "position.a"),
        (lambda c: c["position.a"].__setitem__(np.arange(1000) % 3 > 0, np.nan), "info", "slow sensor", "position.a"),
        (lambda c: c.update({"command.a": np.clip(c["command.a"], -0.4, 0.4)}), "info", "clipped command", "command.a"),
        (lambda c: c.update({"command.a": c["velocity.a"].copy()}), "warning", "kind of drive", "command.a"),
        (lambda c: c.update({"enabled.a": np.repeat([1.0, 0.0], 500)}), "info", "motor off", "enabled.a"),
    ],
)
def test_a_planted_fault_of_an_arm_is_found(fault: Fault, severity: str, kind: str, column: str) -> None:
    assert (kind, column) in kinds(audit(with_fault(arms(), fault), ARM), severity)


@pytest.mark.parametrize(
    ("fault", "severity", "kind", "column"),
    [
        (scaled(DEG, "pose.theta"), "error", "degrees", "pose.theta"),
        (scaled(DEG, "command.left"), "error", "degrees", "command.left"),
        (scaled(30.0 / np.pi, "velocity.left"), "warning", "rpm", "velocity.left"),
        (scaled(-1.0, "pose.theta"), "warning", "sign", "pose.theta"),
        (
            both(swapped("command.left", "command.right"), swapped("velocity.left", "velocity.right")),
            "warning",
            "sign",
            "pose.theta",
        ),
        (scaled(-1.0, "command.left", "command.right"), "warning", "sign", "command.left"),
        (wrapped("pose.theta", 2.0 * np.pi), "info", "wrapped angle", "pose.theta"),
        (wrapped("pose.theta", 360.0), "error", "degrees", "pose.theta"),
        (swapped("pose.x", "pose.y"), "error", "swapped", "pose.x"),
        (lambda c: c.update({"pose.theta": c["pose.theta"] - 0.6}), "warning", "frames", "pose.theta"),
        (scaled(1000.0, "pose.x", "pose.y"), "warning", "unit", "pose.x"),
        (without_encoders(scaled(30.0 / np.pi, "command.left", "command.right")), "warning", "unit", "command.left"),
        (without_encoders(scaled(DEG, "command.left", "command.right")), "warning", "unit", "command.left"),
        (scaled(0.0, "pose.y"), "warning", "stuck sensor", "pose.y"),
        (frozen(100, 220), "warning", "frozen sensor", "pose"),
    ],
)
def test_a_planted_fault_of_a_wheeled_robot_is_found(fault: Fault, severity: str, kind: str, column: str) -> None:
    assert (kind, column) in kinds(audit(with_fault(wheels(), fault), WHEELS), severity)


def test_a_velocity_drive_that_gets_positions_is_told() -> None:
    drives = replace(ARM, actuators=tuple(replace(a, kind="velocity") for a in ARM.actuators))
    assert ("kind of drive", "command.a") in kinds(audit(arms(), drives), "warning")


@pytest.mark.parametrize("angle", [0.6, -0.6, np.pi - 0.6])
def test_the_angle_between_the_frames_is_measured(angle: float) -> None:
    def fault(columns: Columns) -> None:
        columns["pose.theta"] = columns["pose.theta"] - angle

    (found,) = (f for f in audit(with_fault(wheels(), fault), WHEELS) if f.kind == "frames")
    assert float(found.remedy.split("add ")[1].split(" rad")[0]) == pytest.approx(angle, abs=0.03)


def test_a_point_ahead_of_the_axle_that_only_drives_curves_is_not_said_to_be_in_another_frame() -> None:
    t = 0.05 * np.arange(800)
    speed, turn = 0.3 + 0.1 * np.sin(0.7 * t), 0.8 + 0.2 * np.sin(0.7 * t)
    theta = np.cumsum(turn) * 0.05
    x, y = np.cumsum(speed * np.cos(theta)) * 0.05, np.cumsum(speed * np.sin(theta)) * 0.05
    columns = {
        "command.left": (speed - 0.25 * turn) / 0.1,
        "command.right": (speed + 0.25 * turn) / 0.1,
        "pose.x": x + 0.2 * np.cos(theta),
        "pose.y": y + 0.2 * np.sin(theta),
        "pose.theta": theta,
    }
    assert "frames" not in {f.kind for f in audit([Run("curves", t, columns)], WHEELS)}


def test_a_robot_that_spins_and_whose_heading_is_late_is_not_said_to_be_in_another_frame() -> None:
    t = 0.05 * np.arange(800)
    turn = 1.2 * np.sin(0.9 * t) + 0.5 * np.sin(2.1 * t)
    theta = np.cumsum(turn) * 0.05
    late = np.concatenate([np.full(4, theta[0]), theta[:-4]])
    columns = {"command.left": -2.5 * turn, "command.right": 2.5 * turn, "pose.x": 0.3 * np.cos(theta)}
    columns |= {"pose.y": 0.3 * np.sin(theta), "pose.theta": late}
    assert "frames" not in {f.kind for f in audit([Run("spins", t, columns)], WHEELS)}


@pytest.mark.parametrize("hertz", [0.2, 0.5, 0.65])
def test_a_reversed_servo_is_no_velocity_drive(hertz: float) -> None:
    t = 0.02 * np.arange(1000)
    columns = {f"command.{j}": np.sin(2.0 * np.pi * hertz * t) for j in "abc"}
    columns |= {f"position.{j}": -0.95 * np.sin(2.0 * np.pi * hertz * (t - 0.04)) for j in "abc"}
    assert "kind of drive" not in {f.kind for f in audit([Run("r", t, columns)], ARM)}


def test_a_noisy_velocity_drive_is_one() -> None:
    """Differences of a fast log's positions are mostly noise."""
    t, drives = 0.001 * np.arange(12000), replace(ARM, actuators=(replace(ARM.actuators[0], kind="velocity"),))
    noise = 0.002 * np.random.default_rng(0).standard_normal(len(t))
    columns = {"command.a": 0.2 * np.pi * np.cos(np.pi * t), "position.a": 0.2 * np.sin(np.pi * t) + noise}
    assert "kind of drive" not in {f.kind for f in audit([Run("r", t, columns)], drives)}


def test_an_axis_that_rests_at_zero_is_not_said_to_be_clipped() -> None:
    def fault(columns: Columns) -> None:
        columns["command.a"] = np.minimum(columns["command.a"], 0.0)

    assert "clipped command" not in {f.kind for f in audit(with_fault(arms(), fault), ARM)}


def test_a_motion_that_rests_at_several_places_is_not_said_to_be_clipped() -> None:
    """Its highest place is one of them; a clipped command rests nowhere else."""

    def fault(columns: Columns) -> None:
        y = np.minimum(columns["command.a"], np.quantile(columns["command.a"], 0.95))
        y[100:140], y[200:240] = 0.1, -0.2
        columns["command.a"] = y

    assert "clipped command" not in {f.kind for f in audit(with_fault(arms(), fault), ARM)}


def test_a_column_with_a_typing_mistake_is_an_error() -> None:
    """The joint would not be compared; a name of another joint is only strange."""
    facts = replace(ARM, channels=(*(c for c in ARM.channels if c != "position.a"), "position.elbow_joint"))

    def named(name: str) -> list[Finding]:
        runs = with_fault(arms(), lambda c: c.update({name: c.pop("position.a")}))
        return [f for f in audit(runs, facts) if f.kind == "unknown channel"]

    assert [(f.severity, f.remedy) for f in named("position.elbo_joint")] == [
        ("error", "did you mean 'position.elbow_joint'?")
    ]
    assert [f.severity for f in named("position.gripper")] == ["warning"]
    assert [f.severity for f in named("velocity.elbow_joint")] == ["warning"]


@pytest.mark.parametrize(("moved", "said"), [(1.0, True), (0.2, False)])
def test_a_joint_that_moves_far_under_a_constant_command_is_said(moved: float, said: bool) -> None:
    """Less is how a servo sags or is pushed."""

    def fault(columns: Columns) -> None:
        columns["command.a"] = np.full_like(columns["command.a"], 0.3)
        columns["position.a"] = moved * np.linspace(-0.5, 0.5, len(columns["position.a"]))

    found = [f for f in audit(with_fault(arms()[:1], fault), ARM) if f.kind == "constant command"]
    assert bool(found) is said
    if said:
        assert (found[0].severity, found[0].column, found[0].run) == ("warning", "command.a", "run0")
        assert "while position.a spans a range of 0.9" in found[0].message


def test_a_sample_that_jumps_far_away_says_nothing_of_units_or_steps() -> None:
    def fault(columns: Columns) -> None:
        columns["pose.x"][150] = 1e6

    found = kinds(audit(with_fault(wheels(), fault), WHEELS), "error", "warning", "info")
    assert ("spikes", "pose.x") in found and not {k for k, _ in found} & {"degrees", "coarse steps", "unit", "swapped"}


def test_normal_logs_are_not_said_to_be_stuck_or_frozen() -> None:
    """A straight drive along an axis, wheels inside a dead zone, a localisation at 1 Hz, torques on wheels."""
    t = 0.05 * np.arange(600)
    straight = {"command.left": np.ones(600), "command.right": np.ones(600), "pose.x": 0.1 * t}
    straight |= {"pose.y": np.zeros(600), "pose.theta": np.zeros(600)}
    slow = wheels()[0]
    every = np.arange(len(slow.t)) // 20 * 20
    held_pose = {n: y[every] if n.startswith("pose.") else y for n, y in slow.columns.items() if "velocity" not in n}
    for columns in (straight, held_pose):
        found = kinds(audit([Run("r", t[: len(columns["pose.x"])], columns)], WHEELS), "error", "warning")
        assert not {kind for kind, _ in found} & STUCK
    torques = replace(WHEELS, actuators=tuple(replace(a, kind="torque") for a in WHEELS.actuators))
    assert not {k for k, _ in kinds(audit([Run("r", t, straight)], torques))} & STUCK


def test_a_robot_that_mostly_stands_still_shows_degrees_as_well() -> None:
    def fault(columns: Columns) -> None:
        columns["pose.theta"] *= DEG

    def standing(run: Run) -> Run:
        rows = 12000
        columns = {
            n: np.concatenate([y, np.full(rows, 0.0 if n.startswith("command") else y[-1])])
            for n, y in run.columns.items()
        }
        return Run(run.name, 0.05 * np.arange(len(columns["pose.x"])), columns)

    found = kinds(audit([standing(r) for r in with_fault(wheels(), fault)], WHEELS), "error")
    assert ("degrees", "pose.theta") in found


def test_a_noisy_heading_about_half_a_turn_has_no_outliers() -> None:
    """It changes its sign for a single sample now and then."""
    t = np.arange(0.0, 20.0, 0.05)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(t))
    heading = np.pi - 0.02 + noise
    columns = dict.fromkeys(("command.left", "command.right"), np.sin(t)) | {
        "pose.theta": (heading + np.pi) % (2.0 * np.pi) - np.pi
    }
    run = Run("run", t, columns)
    assert np.abs(np.diff(columns["pose.theta"])).max() > 6.0
    assert not check_jumps([run], WHEELS)


def test_a_run_whose_clock_is_off_is_named() -> None:
    rng = np.random.default_rng(3)
    runs = [wheel_run(rng, f"run{k}") for k in range(8)]
    odd = with_fault(runs[5:6], both(*(late(f"pose.{axis}", 6) for axis in ("x", "y", "theta"))))
    findings = audit([*runs[:5], *odd, *runs[6:]], WHEELS)
    assert [(f.kind, f.run) for f in findings if f.severity == "warning"] == [("clock offset", "run5")]


def test_an_angle_beside_its_speed_is_no_strange_channel() -> None:
    angle = {r.name: np.cumsum(r.columns["velocity.left"]) for r in wheels()}
    turning = [replace(r, columns={**r.columns, "position.left": angle[r.name]}) for r in wheels()]
    assert ("unused angle", "position.left") in kinds(audit(turning, WHEELS), "info")
    assert not kinds(audit(turning, WHEELS))
    alone = [replace(r, columns={k: v for k, v in r.columns.items() if k != "velocity.left"}) for r in turning]
    assert ("unknown channel", "position.left") in kinds(audit(alone, WHEELS), "warning")


def test_stamps_are_audited() -> None:
    first, second, third = arms()
    gap = replace(second, t=np.where(np.arange(1000) < 500, second.t, second.t + 2.0))
    slow = replace(third, t=20.0 * third.t)
    findings = audit([first, gap, slow], ARM)
    assert {"gap in time", "slow rate", "rates differ"} <= {f.kind for f in findings}
    assert next(f for f in findings if f.kind == "gap in time").row == 499


def test_errors_come_first_and_a_foreign_robot_is_one() -> None:
    foreign = RobotFacts((ActuatorFacts("wheel", "wheel", "velocity"),), ("position.wheel",))
    findings = audit(arms(), foreign)
    assert {f.kind for f in findings if f.severity == "error"} == {"missing command", "nothing to compare"}
    order = ["error", "warning", "info"]
    assert [f.severity for f in findings] == sorted((f.severity for f in findings), key=order.index)


HUSKY = replace(WHEELS, channels=(*WHEELS.channels, "twist.theta"))
SERVOS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
ROBOTS = {
    "husky_drive": HUSKY,
    "husky_terrain": HUSKY,
    "so101": RobotFacts(
        tuple(ActuatorFacts(j, j, "position") for j in SERVOS),
        tuple(f"{kind}.{j}" for kind in ("position", "velocity") for j in SERVOS),
    ),
    "xl330": RobotFacts((ActuatorFacts("servo", "shaft", "position"),), ("position.shaft", "velocity.shaft")),
}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.slow
def test_recorded_robots_raise_no_false_alarm(robot: str) -> None:
    folder = RECORDED / robot
    if not folder.is_dir():
        pytest.skip(f"no recorded runs at {folder}")
    result = read_runs([folder], read_robot_file(folder / "robot.toml"))
    assert kinds(result.findings) == set()
    stopped = {("stop", "position.wrist_roll")} if robot == "so101" else set()  # which its model lets turn on
    assert kinds(audit(result.runs, ROBOTS[robot])) == stopped


def test_positions_in_degrees_name_the_command_that_corrects_them() -> None:
    found = audit(with_fault(arms(), scaled(DEG, "position.a", "velocity.a", "command.a")), ARM)
    assert any("--mended DIR" in f.remedy for f in found if f.kind == "degrees")


def test_a_robot_that_turns_on_a_slope_is_not_told_that_its_heading_is_in_degrees() -> None:
    """It drifts down, whichever way it points."""
    rng, t = np.random.default_rng(0), 0.025 * np.arange(700)
    turn = 3.0 * np.sign(np.sin(0.7 * t))  # rad/s of the wheels, in opposite directions
    columns = {
        "command.left": -turn,
        "command.right": turn,
        "pose.x": 0.05 * t + 1e-3 * rng.standard_normal(t.size),
        "pose.y": 1e-3 * rng.standard_normal(t.size),
        "pose.theta": np.cumsum(turn) * 0.025 * 0.4 + 2e-3 * rng.standard_normal(t.size),
    }
    found = kinds(audit([Run("turns", t, columns)], WHEELS), "error")
    assert not found
