"""Incidents: what a sensor or a robot that is off makes of a log, and what looks like it and is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from run_tables import ARM, WHEELS, arm_run, wheel_run

from residual_mpc.logs.audit import audit, with_incidents
from residual_mpc.logs.run import Run

Spoil = Callable[[Run], Run]
KINDS = {"step", "frozen sensor", "standing", "carried"}


def wheels(count: int = 3) -> list[Run]:
    rng = np.random.default_rng(3)
    return [wheel_run(rng, f"run{k}") for k in range(count)]


def arms(count: int = 3) -> list[Run]:
    rng = np.random.default_rng(4)
    return [arm_run(rng, f"run{k}") for k in range(count)]


def changed(run: Run, **columns: np.ndarray) -> Run:
    return replace(run, columns={**run.columns, **{k.replace("__", "."): v for k, v in columns.items()}})


def jumped(run: Run) -> Run:
    """A localisation that corrects itself by 0.4 m in mid-run."""
    later = run.t > 0.5 * run.t[-1]
    return changed(run, pose__x=run.columns["pose.x"] + 0.4 * later, pose__y=run.columns["pose.y"] - 0.2 * later)


def frozen(run: Run) -> Run:
    """A pose that repeats itself for 1.5 s and then catches up."""
    columns = dict(run.columns)
    rows = np.flatnonzero((run.t > 8.0) & (run.t < 9.5))
    for name in ("pose.x", "pose.y", "pose.theta"):
        columns[name] = columns[name].copy()
        columns[name][rows] = columns[name][rows[0]]
    return replace(run, columns=columns)


def stopped(run: Run) -> Run:
    """An emergency stop for 3 s: the robot stands where it is, and then goes on with what it is told."""
    period, k = run.period, int(np.searchsorted(run.t, 8.0))
    count = int(3.0 / period)
    rng = np.random.default_rng(0)
    columns = {}
    for name, y in run.columns.items():
        still = y[k : k + count] if name.startswith("command.") else np.full(count, y[k])
        if name.startswith("velocity."):
            still = np.zeros(count)
        noise = 1e-3 * rng.normal(size=count) if name.startswith("pose.") else 0.0
        columns[name] = np.concatenate([y[:k], still + noise, y[k:]])
    return replace(run, t=period * np.arange(len(run.t) + count), columns=columns)


def carried_off(run: Run) -> Run:
    """At 8 s the robot is told to stand; from 9 to 10.5 s someone carries it 0.6 m."""
    period, k = run.period, int(np.searchsorted(run.t, 8.0))
    rest, way = int(1.0 / period), int(1.5 / period)
    gone = np.concatenate([np.zeros(rest), 0.3 - 0.3 * np.cos(np.pi * np.arange(way) / way)])
    rng = np.random.default_rng(0)
    columns = {}
    for name, y in run.columns.items():
        amid, later = np.full(len(gone), y[k]), y[k:].copy()
        if name == "pose.x":
            amid, later = amid + gone, later + 0.6
        if name.startswith("pose."):
            amid = amid + 1e-3 * rng.normal(size=len(gone))
        else:
            amid = np.zeros(len(gone))
        columns[name] = np.concatenate([y[:k], amid, later])
    return replace(run, t=period * np.arange(len(run.t) + len(gone)), columns=columns)


@pytest.mark.parametrize(
    ("spoil", "kind", "begin", "end"),
    [(jumped, "step", None, None), (frozen, "frozen sensor", 8.0, 9.5), (stopped, "standing", 8.0, 11.0),
     (carried_off, "carried", 9.0, 10.5)],
)  # fmt: skip
def test_wheels(spoil: Spoil, kind: str, begin: float | None, end: float | None) -> None:
    runs = wheels()
    runs[1] = spoil(runs[1])
    findings = [f for f in audit(runs, WHEELS) if f.kind in KINDS]
    assert [(f.kind, f.run, f.severity) for f in findings] == [(kind, "run1", "warning")]
    found = with_incidents(runs, WHEELS)
    assert found[0].incidents == found[2].incidents == ()
    ((first, last),) = found[1].incidents
    middle = 0.5 * runs[1].t[-1]
    assert first == pytest.approx(middle if begin is None else begin, abs=0.4)
    assert last == pytest.approx(middle if end is None else end, abs=0.4)


def test_a_frozen_joint_of_an_arm() -> None:
    runs = arms()
    y = runs[0].columns["position.b"].copy()
    first = 300 + int(np.argmax(np.abs(y[400:900] - y[300:800])))  # 2 s in which it goes far
    y[first : first + 100] = y[first]
    runs[0] = changed(runs[0], position__b=y)
    (finding,) = [f for f in audit(runs, ARM) if f.kind in KINDS]
    assert (finding.kind, finding.column, finding.run) == ("frozen sensor", "position.b", "run0")
    assert with_incidents(runs, ARM)[0].incidents == ((runs[0].t[first], runs[0].t[first + 100]),)


def test_a_sensor_that_is_frozen_from_the_first_row_on() -> None:
    runs = wheels()
    columns = dict(runs[0].columns)
    for name in ("pose.x", "pose.y", "pose.theta"):
        columns[name] = np.where(runs[0].t < 2.0, columns[name][0], columns[name])
    runs[0] = replace(runs[0], columns=columns)
    ((first, last),) = with_incidents(runs, WHEELS)[0].incidents
    assert first == 0.0 and last == pytest.approx(2.0, abs=0.1)


def test_a_robot_that_stops_slowly_or_creeps_down_a_slope_is_not_carried() -> None:
    """It does not set off: it is fastest when it is told to stand, or creeps from then on."""
    runs = []
    for run, creep in zip(wheels(4), (0.0, 0.0, 0.08, 0.08), strict=True):  # m/s
        gone = carried_off(run)
        since = gone.t - 8.0
        during = (since > 0.0) & (since < 2.5)
        coast = np.where(since > 0.0, 0.2 * (1.0 - np.exp(-np.minimum(since, 2.5) / 0.6)), 0.0)
        x = gone.columns["pose.x"] - np.where(since > 2.5, 0.6, 0.0)
        still = run.columns["pose.x"][int(np.searchsorted(run.t, 8.0))]
        noise = 2e-3 * np.random.default_rng(1).normal(size=len(x))
        x = np.where(during, still + noise, x) + (coast if creep == 0.0 else creep * gone.t)
        runs.append(changed(gone, pose__x=x))
    assert not [f for f in audit(runs, WHEELS) if f.kind == "carried"]


def test_what_happens_all_the_time_is_not_left_out() -> None:
    """A pose that freezes for a third of the time is how this robot is."""
    runs = []
    for run in wheels(2):
        columns = dict(run.columns)
        for begin in (3.0, 10.0, 17.0, 24.0):
            rows = np.flatnonzero((run.t > begin) & (run.t < begin + 2.5))
            for name in ("pose.x", "pose.y", "pose.theta"):
                columns[name] = columns[name].copy()
                columns[name][rows] = columns[name][rows[0]]
        runs.append(replace(run, columns=columns))
    (finding,) = [f for f in audit(runs, WHEELS) if f.kind in KINDS]
    assert finding.remedy.endswith("too long to be left out of fits")
    assert not any(r.incidents for r in with_incidents(runs, WHEELS))


def test_runs_as_they_are_have_none() -> None:
    for runs, facts in ((wheels(6), WHEELS), (arms(6), ARM)):
        assert not [f for f in audit(runs, facts) if f.kind in KINDS]
        assert with_incidents(runs, facts) == tuple(runs)


def test_outliers_come_back_and_are_none() -> None:
    runs = wheels()
    x = runs[0].columns["pose.x"].copy()
    x[[150, 260, 261, 400]] += 0.8
    runs[0] = changed(runs[0], pose__x=x)
    assert not [f for f in audit(runs, WHEELS) if f.kind in KINDS]


def test_a_robot_in_its_dead_zone_stands_still_by_itself() -> None:
    """It does so whenever its commands are that small."""
    runs = []
    for run in wheels():
        standing = stopped(run)
        asleep = (standing.t > 8.0) & (standing.t < 11.0)
        columns = dict(standing.columns)
        for name in ("command.left", "command.right"):
            sent = np.where(np.abs(columns[name]) < 2.0, 0.0, columns[name])  # rad/s: what moves it is larger
            columns[name] = np.where(asleep, 1.0, sent)
        runs.append(replace(standing, columns=columns))
    assert not [f for f in audit(runs, WHEELS) if f.kind == "standing"]
