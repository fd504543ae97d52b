"""A mistake in a few runs, which all runs together hide, is found and named with the run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from run_tables import ARM, WHEELS, arm_run, wheel_run

from residual_mpc.logs.audit import RobotFacts, audit
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run

DEG = 180.0 / np.pi


def runs_of(robot: RobotFacts, count: int = 5) -> list[Run]:
    rng, make = np.random.default_rng(3), wheel_run if robot is WHEELS else arm_run
    return [make(rng, f"run{k}") for k in range(count)]


def exchanged(run: Run, *pairs: tuple[str, str]) -> Run:
    columns = dict(run.columns)
    for a, b in pairs:
        columns[a], columns[b] = columns[b], columns[a]
    return replace(run, columns=columns)


def scaled(run: Run, factor: float, *names: str) -> Run:
    return replace(run, columns={k: factor * v if k in names else v for k, v in run.columns.items()})


def alone(findings: tuple[Finding, ...]) -> list[tuple[str, str, str]]:
    return [(f.kind, f.run, f.column) for f in findings if "only in this run" in f.message or "one first" in f.message]


def test_runs_that_are_alike_show_nothing() -> None:
    for robot in (ARM, WHEELS):
        assert alone(audit(runs_of(robot), robot)) == []


@pytest.mark.parametrize(
    ("robot", "spoil", "kind", "column"),
    [
        (ARM, lambda r: exchanged(r, ("position.a", "position.b"), ("velocity.a", "velocity.b")), "swapped channels",
         "position.a"),
        (ARM, lambda r: scaled(r, -1.0, "position.a", "velocity.a"), "sign", "position.a"),
        (ARM, lambda r: scaled(r, -1.0, "velocity.b"), "sign", "velocity.b"),
        (ARM, lambda r: scaled(r, DEG, "velocity.c"), "degrees", "velocity.c"),
        (WHEELS, lambda r: exchanged(r, ("command.left", "command.right"), ("velocity.left", "velocity.right")), "sign",
         "pose.theta"),
        (WHEELS, lambda r: scaled(r, DEG, "pose.theta"), "degrees", "pose.theta"),
        (WHEELS, lambda r: exchanged(r, ("pose.x", "pose.y")), "swapped", "pose.x"),
        (WHEELS, lambda r: scaled(r, 1000.0, "pose.x", "pose.y"), "unit", "pose.x"),
    ],
)  # fmt: skip
def test_a_mistake_in_one_run_is_named_with_the_run(robot: RobotFacts, spoil, kind: str, column: str) -> None:
    runs = runs_of(robot)
    runs[3] = spoil(runs[3])
    found = alone(audit(runs, robot))
    assert (kind, "run3", column) in found
    assert {run for _, run, _ in found} == {"run3"}


def test_two_of_five_are_counted_and_all_of_them_are_no_exception() -> None:
    runs = [scaled(r, -1.0, "velocity.b") if k in (1, 4) else r for k, r in enumerate(runs_of(ARM))]
    (found,) = (f for f in audit(runs, ARM) if f.column == "velocity.b" and f.kind == "sign")
    assert found.run == "run1" and found.message.endswith("(in 2 of 5 runs, this one first)")
    every = audit([scaled(r, -1.0, "velocity.b") for r in runs_of(ARM)], ARM)
    assert [f.run for f in every if f.kind == "sign"] == [""]


@pytest.mark.parametrize("count", [2, 3, 5])
def test_one_mistake_of_one_run_is_told_once(count: int) -> None:
    """The command and the velocity both show it; a joint without limits is not looked at otherwise."""
    free = replace(ARM, limits={})
    runs = [scaled(r, DEG, "position.a") if k == 1 else r for k, r in enumerate(runs_of(free, count))]
    (found,) = (f for f in audit(runs, free) if f.kind == "degrees" and f.column == "position.a")
    assert found.run == "run1" and "only in this run" in found.message


def test_most_runs_with_a_mistake_are_told_too() -> None:
    """All together, two of three with a reversed sign and one without show nothing."""
    reverse = ("position.a", "velocity.a")
    runs = [r if k == 0 else scaled(r, -1.0, *reverse) for k, r in enumerate(runs_of(ARM, 3))]
    found = [f for f in audit(runs, ARM) if f.kind == "sign" and f.column == "position.a"]
    assert [f.run for f in found] == ["run1"] and found[0].message.endswith("(in 2 of 3 runs, this one first)")


def test_degrees_in_some_runs_alone_are_not_to_be_corrected_in_all() -> None:
    columns = ("position.a", "velocity.a", "command.a")
    some = [scaled(r, DEG, *columns) if k == 2 else r for k, r in enumerate(runs_of(ARM))]
    for runs, mends in ((some, False), ([scaled(r, DEG, *columns) for r in runs_of(ARM)], True)):
        (found,) = (f for f in audit(runs, ARM) if f.kind == "degrees" and f.column == "position.a")
        assert ("init" in found.remedy) == mends and found.message.endswith("in this run") != mends
        assert not [f for f in audit(runs, ARM) if f.kind == "beyond the range"]


def test_a_gait_is_no_velocity_with_a_wrong_sign() -> None:
    """Half a period later, it is its own negative, and here a little more so than it is itself without a shift."""
    t = np.arange(0.0, 12.0, 0.01)
    rate = 2.0 * np.sin(2.0 * np.pi * t / 0.5)
    late = np.interp(t - 0.02, t, rate)
    runs = []
    for k in range(2):
        noise = 0.001 * np.random.default_rng(k).standard_normal(len(t))
        q = np.cumsum(rate) * 0.01 + noise
        columns = {"position.a": q, "velocity.a": late, "command.a": q.copy()}
        runs.append(Run(f"run{k}", t, columns))
    assert not [f for f in audit(runs, ARM) if f.kind == "sign"]
    flipped = [scaled(r, -1.0, "velocity.a") for r in runs]
    assert [f for f in audit(flipped, ARM) if f.kind == "sign" and f.column == "velocity.a"]


def test_encoder_counts_are_no_radians() -> None:
    """2048 counts a turn: the speed is 326 times what was commanded, in all runs or in one."""
    counts = 2048.0 / (2.0 * np.pi)
    names = ("velocity.left", "velocity.right")
    for runs, run in (
        ([scaled(r, counts, *names) for r in runs_of(WHEELS)], ""),
        ([scaled(r, counts, *names) if k == 2 else r for k, r in enumerate(runs_of(WHEELS))], "run2"),
    ):
        found = [f for f in audit(runs, WHEELS) if f.kind == "unit"]
        assert {(f.run, f.column) for f in found} == {(run, n) for n in names}
        assert all("counts of one turn" in f.remedy for f in found)
