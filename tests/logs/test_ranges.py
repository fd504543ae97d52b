"""Ranges of the model that its robot went beyond: the model is used without the ends that were passed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from run_tables import ARM, arm_run

from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.ranges import check_ranges, passed_ranges
from residual_mpc.logs.run import Run

RUN = arm_run(np.random.default_rng(0))


def moved(to: float, column: str = "position.b", rows: slice = slice(40, 60)) -> Run:
    """The run with a stretch at another place."""
    y = RUN.columns[column].copy()
    y[rows] = to
    return replace(RUN, columns={**RUN.columns, column: y})


def facts(limit: tuple[float, float] | None = None, clamp: tuple[float, float] | None = None) -> RobotFacts:
    actuator = next(a for a in ARM.actuators if a.joint == "b")
    return replace(
        ARM, limits={} if limit is None else {"b": limit}, clamps={} if clamp is None else {actuator.name: clamp}
    )


def test_a_joint_beyond_its_range_passed_the_stop() -> None:
    (passed,) = passed_ranges([RUN, moved(2.4)], facts((-2.0, 2.0)))
    assert (passed.of, passed.name, passed.stated) == ("joint", "b", (-2.0, 2.0))
    assert passed.reached == (-2.0, 2.4) and passed.row == 40
    assert passed.widened == (-2.0, pytest.approx(6.4))  # the other stop stays
    (finding,) = check_ranges([RUN, moved(2.4)], facts((-2.0, 2.0)))
    assert (finding.severity, finding.column, finding.row) == ("warning", "position.b", 40)
    assert (
        "reaches 2.4, beyond the joint range -2 to 2" in finding.message and "without the upper stop" in finding.message
    )


@pytest.mark.parametrize(
    "run",
    [RUN, moved(2.05), moved(2.4, rows=slice(40, 42)), moved(np.nan), moved(140.0)],
    ids=["inside", "a soft stop", "outliers", "nothing measured", "degrees"],
)
def test_what_stays_inside_or_is_no_angle_passes_nothing(run: Run) -> None:
    assert passed_ranges([run], facts((-2.0, 2.0))) == () and check_ranges([run], facts((-2.0, 2.0))) == []


def test_a_range_in_radians_that_the_model_file_reads_as_degrees_is_said_to_be_one() -> None:
    stated = (-2.0 * np.pi / 180.0, 2.0 * np.pi / 180.0)
    run = replace(RUN, columns={**RUN.columns, "position.b": 0.7 * np.sin(RUN.t)})
    (passed,) = passed_ranges([run], facts(stated))
    assert passed.widened[0] < -0.7 and passed.widened[1] > 0.7
    (finding,) = check_ranges([run], facts(stated))
    assert "if -2 to 2 rad is meant" in finding.remedy and "without either stop" in finding.message
    assert passed_ranges([run], replace(facts(stated), sliding=frozenset({"b"}))) == ()
    far = replace(RUN, columns={**RUN.columns, "position.b": 2.4 * np.sin(RUN.t)})
    assert passed_ranges([far], facts(stated)) == ()


def test_a_clipped_command_that_the_joint_follows() -> None:
    """Only on the side on which the joint was measured beyond it; on others the model may be right to clip."""
    wide = moved(2.4, "command.b")
    both = replace(wide, columns={**wide.columns, "position.b": moved(2.3).columns["position.b"]})
    (passed,) = passed_ranges([both], facts(None, (-2.0, 2.0)))
    assert (passed.of, passed.stated, passed.reached) == ("command", (-2.0, 2.0), (-2.0, 2.4))
    (finding,) = check_ranges([both], facts(None, (-2.0, 2.0)))
    assert finding.severity == "warning" and "the joint follows" in finding.message
    assert passed_ranges([wide], facts(None, (-2.0, 2.0))) == ()
    (finding,) = check_ranges([wide], facts(None, (-2.0, 2.0)))
    assert finding.severity == "info" and "the model, which clips it" in finding.message


def test_a_servo_that_turns_the_other_way() -> None:
    """Its command is minus twice the joint's position."""
    wide = moved(-4.8, "command.b")
    both = replace(wide, columns={**wide.columns, "position.b": moved(2.4).columns["position.b"]})
    known = facts(None, (-4.0, 4.0))
    turned = replace(known, actuators=tuple(replace(a, gear=-2.0) for a in known.actuators))
    (passed,) = passed_ranges([both], turned)
    assert passed.reached == (-4.8, 4.0)
