"""Joints and commands beyond the ranges that the model states.

A robot cannot be where its model has a stop: a joint that was measured there shows that the stop, or the zero of the
readings, is wrong. Replayed against the stop, the model would be pushed back, which looks like another load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from residual_mpc.logs.audit.facts import ActuatorFacts, RobotFacts
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import FloatArray, Run

MARGIN = 0.02  # of the range: stops are soft, and zeros are a little off
LASTING = 3  # samples in a row, so that outliers do not count
FARTHEST = 100.0  # rad: a range that would be larger if its numbers were radians is not one in degrees
FAR = 5.0  # times the range: such angles are in degrees, and that is said elsewhere
DEGREES = 180.0 / np.pi  # in a radian
Range = tuple[float, float]
Of = Literal["joint", "command"]
JOINT: Of = "joint"
COMMAND: Of = "command"


@dataclass(frozen=True)
class PassedRange:
    """A range that the runs went beyond.

    Attributes:
        of: of a joint, rad or m, or of an actuator's command, its unit.
        name: of the joint or actuator.
        stated: lowest and highest value by the model. reached: the same in the runs, as far as it lasted.
        run: the first that went beyond, and row: where it did.
    """

    of: Of
    name: str
    stated: Range
    reached: Range
    run: str
    row: int

    @property
    def widened(self) -> Range:
        """The range without the ends that were passed: they lie a whole range farther than the runs got."""
        (low, high), (lowest, highest) = self.stated, self.reached
        width = high - low
        return (lowest - width if lowest < low else low), (highest + width if highest > high else high)


def passed_ranges(runs: Sequence[Run], robot: RobotFacts) -> tuple[PassedRange, ...]:
    """Ranges of the model that the robot went beyond: those of joints that were measured outside, and those of the
    commands of position servos that were sent outside, and whose joints followed."""
    joints = [
        _passed(JOINT, f"position.{j}", j, stated, runs, j not in robot.sliding) for j, stated in robot.limits.items()
    ]
    servos = [a for a in robot.actuators if a.kind == "position" and a.name in robot.clamps]
    commands = [_followed(a, robot.clamps[a.name], runs) for a in servos]
    return tuple(p for p in (*joints, *commands) if p is not None)


def check_ranges(runs: Sequence[Run], robot: RobotFacts) -> list[Finding]:
    """What was passed, and commands that the model clips."""
    passed = passed_ranges(runs, robot)
    findings = [_said(p) for p in passed]
    followed = {p.name for p in passed if p.of == COMMAND}
    for name, stated in robot.clamps.items():
        beyond = None if name in followed else _passed(COMMAND, f"command.{name}", name, stated, runs)
        if beyond is not None:
            findings.append(Finding(
                "info", "beyond the range", beyond.run, f"command.{name}", beyond.row,
                f"command.{name} {_reaches(beyond)}, beyond the command range {_text(stated)} of the model, which "
                "clips it",
                "widen the range of the actuator (ctrlrange) in the model file if the robot does not clip it",
            ))  # fmt: skip
    return findings


def _said(passed: PassedRange) -> Finding:
    if passed.of == JOINT:
        remedy = (
            "widen the range in the model file; if the joint cannot get there, check the unit, sign and zero of this "
            "column"
        )
        if _is_far(passed.stated, passed.reached):
            meant = _text((passed.stated[0] * DEGREES, passed.stated[1] * DEGREES))
            remedy = f"an MJCF file's ranges are in degrees: if {meant} rad is meant, add <compiler angle=\"radian\"/>"
        return Finding(
            "warning", "beyond the range", passed.run, f"position.{passed.name}", passed.row,
            f"position.{passed.name} {_reaches(passed)}, beyond the joint range {_text(passed.stated)} of the model, "
            f"which is used without {_that(passed)} stop",
            remedy,
        )  # fmt: skip
    return Finding(
        "warning", "beyond the range", passed.run, f"command.{passed.name}", passed.row,
        f"command.{passed.name} {_reaches(passed)}, beyond the command range {_text(passed.stated)} of the model, and "
        f"the joint follows: the model is used without {_that(passed)} limit",
        "widen the range of the actuator (ctrlrange) in the model file",
    )  # fmt: skip


def _reaches(passed: PassedRange) -> str:
    (low, high), (lowest, highest) = passed.stated, passed.reached
    ends = [f"{x:.4g}" for x, beyond in ((lowest, lowest < low), (highest, highest > high)) if beyond]
    return f"reaches {' and '.join(ends)}"


def _that(passed: PassedRange) -> str:
    """Which of the two ends."""
    (low, high), (lowest, highest) = passed.stated, passed.reached
    return "either" if lowest < low and highest > high else "the lower" if lowest < low else "the upper"


def _text(stated: Range) -> str:
    return f"{stated[0]:.4g} to {stated[1]:.4g}"


def _is_far(stated: Range, reached: Range) -> bool:
    """Whether the runs went beyond a range by a multiple of it."""
    low, high = stated
    return max(abs(x) for x in reached) > FAR * max(abs(low), abs(high), high - low)


def _read_as_degrees(stated: Range, reached: Range) -> bool:
    """Whether an angle's range in rad holds what was reached if its numbers are read as radians: a model file gives
    them in degrees unless it says otherwise. No joint turns that far where the range is one in radians."""
    if max(abs(x) for x in stated) * DEGREES > FARTHEST:
        return False
    return stated[0] * DEGREES <= reached[0] and reached[1] <= stated[1] * DEGREES


def _passed(
    of: Of, column: str, name: str, stated: Range, runs: Sequence[Run], turns: bool = False
) -> PassedRange | None:
    """The range as the runs reached it; None where they stayed inside. turns: of a joint, whether that is an angle."""
    low, high = stated
    margin = MARGIN * (high - low)
    having = [run for run in runs if column in run.measured or (of == COMMAND and column in run.columns)]
    lasting = [_lasting(run.columns[column]) for run in having]
    if not lasting or not high > low:
        return None
    lowest, highest = (float(end) for end in (min(x[0] for x in lasting), max(x[1] for x in lasting)))
    if not (lowest < low - margin or highest > high + margin):
        return None
    if _is_far(stated, (lowest, highest)) and not (turns and _read_as_degrees(stated, (lowest, highest))):
        return None
    reached = (lowest if lowest < low - margin else low), (highest if highest > high + margin else high)
    first = next(r for r, (a, b) in zip(having, lasting, strict=True) if a < low - margin or b > high + margin)
    y = first.columns[column]
    row = int(np.flatnonzero((y < low - margin) | (y > high + margin))[0])
    return PassedRange(of, name, stated, reached, first.name, row)


def _followed(actuator: ActuatorFacts, stated: Range, runs: Sequence[Run]) -> PassedRange | None:
    """The range of a servo's command on those sides on which the joint, too, went beyond it."""
    sent = _passed(COMMAND, f"command.{actuator.name}", actuator.name, stated, runs)
    if sent is None or actuator.joint is None:
        return None
    ends = sorted(x / actuator.gear for x in stated)
    went = _passed(JOINT, f"position.{actuator.joint}", actuator.joint, (ends[0], ends[1]), runs)
    if went is None:
        return None
    there = [went.reached[0] < went.stated[0], went.reached[1] > went.stated[1]]
    below, above = there if actuator.gear > 0.0 else reversed(there)
    reached = (sent.reached[0] if below else stated[0]), (sent.reached[1] if above else stated[1])
    return None if reached == stated else PassedRange(COMMAND, actuator.name, stated, reached, sent.run, sent.row)


def _lasting(y: FloatArray) -> Range:
    """The lowest and the highest value that several samples in a row keep; (inf, -inf) without that many."""
    y = y[np.isfinite(y)]
    if len(y) < LASTING:
        return np.inf, -np.inf
    rows = np.lib.stride_tricks.sliding_window_view(y, LASTING)
    return float(rows.max(axis=1).min()), float(rows.min(axis=1).max())


def ranges_by_name(passed: Sequence[PassedRange], of: Of) -> Mapping[str, Range]:
    """The widened ranges of joints or commands."""
    return {p.name: p.widened for p in passed if p.of == of}
