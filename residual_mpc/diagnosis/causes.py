"""The causes of a diagnosis: each chosen effect with its probability, and its numbers with their intervals."""

import numpy as np

from residual_mpc.diagnosis.evidence import blocks_of, covariance, dispersion, profile_sigma
from residual_mpc.diagnosis.fit import Fit
from residual_mpc.diagnosis.problem import Problem
from residual_mpc.diagnosis.records import Cause, Estimate
from residual_mpc.diagnosis.rivals import Rivalry
from residual_mpc.diagnosis.spikes import Outliers
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Term

T95 = 1.96
# What the named effects leave unexplained may lie along an effect and pull its number: half of its relative size
# is allowed for
FORM = 0.5
MOST_SURE = 0.97  # the library may lack the cause, whatever the likelihoods say


def causes_of(
    final: Fit,
    problem: Problem,
    rivalry: Rivalry,
    outliers: Outliers,
    with_outliers: bool,
    unexplained: float,
    sure: float,
) -> tuple[Cause, ...]:
    """unexplained: share of the squared gap beyond the floor that is left; sure: what a cause without a rival gets."""
    blocks = blocks_of(problem.data)
    sigma = np.sqrt(np.maximum(np.diag(covariance(final, blocks)), 0.0))
    sigma = np.maximum(sigma, profile_sigma(problem, final, dispersion(final, blocks)))
    causes = []
    for term in final.terms:
        estimates = []
        for i, k in enumerate(final.knobs):
            if k.effect == TUNE or k.term != term:
                continue
            value = final.values[k]
            unit = _unit(problem.space.robot, term, BY_NAME[k.effect].parameter(k.parameter).unit)
            if k.parameter == "heading":
                value = float((value + np.pi) % (2 * np.pi) - np.pi)
            half = float(
                np.hypot(T95 * sigma[i], FORM * np.sqrt(unexplained) * _dose(k.parameter, value, problem.space.null(k)))
            )
            low, high = (-np.inf, np.inf) if k.parameter == "heading" else problem.space.bounds(k)
            interval = float(max(value - half, min(low, value))), float(min(value + half, max(high, value)))
            estimates.append(Estimate(k.parameter, value, interval, unit))
        probability = sure * rivalry.shares.get(term, 1.0)
        slots = problem.space.slots[term.effect]
        only = slots[0] if len(slots) == 1 and BY_NAME[term.effect].target in ("actuator", "joint") else None
        causes.append(Cause(term, probability, tuple(estimates), BY_NAME[term.effect].summary, only))
    if with_outliers:
        from scipy.stats import binomtest  # half a second to load, for what few runs have

        channel = max(outliers.shares, key=lambda c: outliers.shares[c])
        marks = [m for (_, c), m in outliers.flagged.items() if c == channel]
        counted = binomtest(int(sum(m.sum() for m in marks)), sum(len(m) for m in marks))
        low, high = counted.proportion_ci(method="wilson")
        estimate = Estimate("rate", outliers.share, (float(low), float(high)), "1")
        causes.append(Cause(Term("sensor_outliers", None), MOST_SURE, (estimate,), BY_NAME["sensor_outliers"].summary))
    return tuple(causes)


def most_sure(verdict: str, unexplained: float) -> float:
    """The probability of a cause without a rival: where much is left, something else than the library's effects is at
    work, and what was named may be its shadow."""
    return MOST_SURE * (1.0 - unexplained) if verdict == "partial" else MOST_SURE


def _unit(robot: Robot, term: Term, unit: str) -> str:
    """What "command unit", "actuator unit" and "channel unit" are on this robot; joints are taken to turn."""
    if unit == "channel unit":
        return "rad" if (term.target or "").startswith(("position.", "pose.theta")) else "rad/s"
    if unit not in ("command unit", "actuator unit"):
        return unit
    kinds = robot.command_kinds
    kind = kinds[robot.actuators.index(term.target)] if term.target in robot.actuators else kinds[0]
    force = {"speed": "rad/s", "velocity": "N m", "position": "N m", "torque": "N m"}
    sent = {"speed": "rad/s", "velocity": "rad/s", "position": "rad", "torque": "N m"}
    return (force if unit == "actuator unit" else sent)[kind]


def _dose(parameter: str, value: float, null: float) -> float:
    """How far a number is from doing nothing; a limit's and an angle's own size says that better than its distance, and
    that of a gain of a fiftieth, its logarithm."""
    if parameter == "heading":
        return 1.0
    if null == 1.0 and 0.0 < value < 1.0 / np.e:
        return float((np.e - 1.0) * value * abs(np.log(value)))  # as large as 1 - value at 1 / e
    return abs(value) if not np.isfinite(null) else abs(value - null)
