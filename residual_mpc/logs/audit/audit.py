"""Every check, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from residual_mpc.logs.audit.channels import check_channels
from residual_mpc.logs.audit.driving import check_driving
from residual_mpc.logs.audit.facts import RobotFacts
from residual_mpc.logs.audit.incidents import check_incidents
from residual_mpc.logs.audit.jumps import check_jumps
from residual_mpc.logs.audit.pairing import check_pairing
from residual_mpc.logs.audit.ranges import check_ranges
from residual_mpc.logs.audit.rates import check_rates
from residual_mpc.logs.audit.single_runs import check_single_runs
from residual_mpc.logs.audit.stamps import check_stamps
from residual_mpc.logs.audit.stops import check_stops
from residual_mpc.logs.audit.values import check_values
from residual_mpc.logs.finding import Finding
from residual_mpc.logs.run import Run

Check = Callable[[Sequence[Run], RobotFacts], list[Finding]]
CHECKS: tuple[Check, ...] = (
    check_stamps, check_channels, check_values, check_ranges, check_jumps, check_incidents, check_pairing, check_rates,
    check_driving, check_single_runs, check_stops,
)  # fmt: skip
RANK = {"error": 0, "warning": 1, "info": 2}


def audit(runs: Sequence[Run], robot: RobotFacts) -> tuple[Finding, ...]:
    """Audit runs against the robot and against each other; errors first.

    A finding of severity "error" means that the data cannot be used as they are. What may be the robot's own
    doing, such as a delay, is "info" however large it is: finding its cause is the diagnosis' part.

    Args:
        runs: at least one.
        robot: what the nominal model says about actuators and channels.
    """
    findings = [finding for check in CHECKS for finding in check(runs, robot)]
    return tuple(sorted(findings, key=lambda finding: RANK[finding.severity]))
