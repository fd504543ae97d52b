"""The causes of a diagnosis: each chosen effect with its probability, and its numbers with their intervals."""

from collections.abc import Mapping

import numpy as np

from residual_mpc.diagnosis.evidence import blocks_of, covariance, dispersion, profile_sigma
from residual_mpc.diagnosis.explained import Explained
from residual_mpc.diagnosis.fit import Fit
from residual_mpc.diagnosis.polish import carry_on
from residual_mpc.diagnosis.problem import Problem
from residual_mpc.diagnosis.records import Cause, Estimate
from residual_mpc.diagnosis.search import without
from residual_mpc.diagnosis.spikes import Outliers
from residual_mpc.diagnosis.support import Support
from residual_mpc.diagnosis.verdict import AS_GOOD
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.protocol import Robot
from residual_mpc.models.settings import TUNE, Knob, Term

T95 = 1.96
# What the named effects leave unexplained may lie along an effect and pull its number: half of its relative size
# is allowed for
FORM = 0.5
MOST_SURE = 0.97  # the library may lack the cause, whatever the likelihoods say
MOST_PARTIAL = 0.87  # factor where something is left that these sensors can tell
SHADOW = 0.15  # of the probability that is lost for each factor e by which more is left than the sensors can tell
LEAST_SURE = 0.5  # factor that stays however much is left
DOUBTFUL = 0.75  # factor on an effect's probability below which the other numbers' intervals do without it too
AT_BOUND, RESTING = "at the bound of its search range", 0.5  # and the factor on the probability of such an effect
APART = 2.5  # half-widths beyond which an interval is that wide since two fits end apart


def causes_of(
    of: Explained,
    unexplained: float,
    sure: float,
    supports: Mapping[Term, Support],
    doubt: Mapping[Term, float],
    lacking: Mapping[Knob, tuple[float, ...]],
) -> tuple[Cause, ...]:
    """unexplained: share of the squared gap beyond the floor that is left; sure: what a cause without a rival gets;
    supports and doubt: of each effect, see `support`; lacking: see `without_doubtful`."""
    final, problem = of.final, of.problem
    sigma = sigmas(problem, final)
    aside = _aside(of)
    causes = []
    for term in final.terms:
        estimates = [
            _estimate(of, i, float(sigma[i]), unexplained, (*aside.get(k, ()), *lacking.get(k, ())))
            for i, k in enumerate(final.knobs)
            if k.effect != TUNE and k.term == term
        ]
        slots = problem.space.slots[term.effect]
        only = slots[0] if len(slots) == 1 and BY_NAME[term.effect].target in ("actuator", "joint") else None
        rests = any(e.note == AT_BOUND for e in estimates)
        probability = sure * of.rivalry.shares.get(term, 1.0) * doubt[term] * (RESTING if rests else 1.0)
        causes.append(
            Cause(term, probability, tuple(estimates), BY_NAME[term.effect].summary, only, supports[term].evidence)
        )
    if of.with_outliers:
        causes.append(_outliers(of.outliers))
    return tuple(causes)


def sigmas(problem: Problem, final: Fit) -> np.ndarray:
    """(P,) 1-sigma of each free number: from the sandwich covariance, for a threshold from its cost's profile, and for
    one that rests on a bound from its curvature alone."""
    blocks = blocks_of(problem.data)
    phi = dispersion(final, blocks)
    sigma = np.sqrt(np.maximum(np.diag(covariance(final, blocks)), 0.0))
    curvature = np.einsum("wnp,wnp->p", final.jacobian, final.jacobian)
    alone = final.scales * np.sqrt(phi / np.maximum(curvature, 1e-300))
    return np.maximum(np.where(final.held & (curvature > 0.0), alone, sigma), profile_sigma(problem, final, phi))


def without_doubtful(of: Explained, doubt: Mapping[Term, float], steps: int) -> dict[Knob, tuple[float, ...]]:
    """Each number's values in the fits without one of the effects that may well not be there; steps: simulation steps
    that each of these fits takes first."""
    doubtful = [t for t in of.final.terms if doubt[t] < DOUBTFUL]
    if len(of.final.terms) < 2 or not doubtful:
        return {}
    fits = carry_on(of.problem, [without(of.final.values, t) for t in doubtful], steps)
    return {k: tuple(f.values[k] for f in fits if k in f.values) for k in of.final.knobs}


def _aside(of: Explained) -> dict[Knob, tuple[float, float]]:
    """The interval of each number, limits included, from the fit in which small differences are marginalised."""
    if of.tolerated is None:
        return {}
    problem, fit = of.tolerated.problem, of.tolerated.fit
    half = T95 * sigmas(problem, fit)
    return {k: (fit.values[k] - h, fit.values[k] + h) for k, h in zip(fit.knobs, half, strict=True)}


def _estimate(of: Explained, i: int, sigma: float, unexplained: float, aside: tuple[float, ...]) -> Estimate:
    """aside: limits of the interval with small differences elsewhere, and values without a doubtful effect, which the
    stated interval includes."""
    knob, final, space = of.final.knobs[i], of.final, of.problem.space
    value = final.values[knob]
    unit = _unit(space.robot, knob.term, BY_NAME[knob.effect].parameter(knob.parameter).unit)
    low, high = space.bounds(knob)
    ends = of.ends.get(knob, (value,))
    if knob.parameter == "heading":
        value, low, high, ends, aside = float((value + np.pi) % (2 * np.pi) - np.pi), -np.inf, np.inf, (), ()
    half = float(np.hypot(T95 * sigma, FORM * np.sqrt(unexplained) * _dose(knob.parameter, value, space.null(knob))))
    apart = max([value + half, *ends]) - min([value - half, *ends]) > APART * half
    interval = (
        float(max(min([value - half, *ends, *aside]), min(low, value))),
        float(min(max([value + half, *ends, *aside]), max(high, value))),
    )
    return Estimate(knob.parameter, value, interval, unit, _note(bool(final.held[i]), apart))


def _note(held: bool, apart: bool) -> str:
    """What is wrong with a number, in words; empty where nothing is."""
    if held:
        return AT_BOUND
    if apart:
        return "two fits from different starts differ and are equally good"
    return ""


def _outliers(outliers: Outliers) -> Cause:
    from scipy.stats import binomtest  # half a second to load, for what few runs have

    channel = max(outliers.shares, key=lambda c: outliers.shares[c])
    marks = [m for (_, c), m in outliers.flagged.items() if c == channel]
    counted = binomtest(int(sum(m.sum() for m in marks)), sum(len(m) for m in marks))
    low, high = counted.proportion_ci(method="wilson")
    estimate = Estimate("rate", outliers.share, (float(low), float(high)), "1")
    term = Term("sensor_outliers", None)
    return Cause(term, MOST_SURE, (estimate,), BY_NAME[term.effect].summary, None, ("fits",))


def most_sure(verdict: str, unexplained: float, times_floor: float) -> float:
    """The probability of a cause without a rival: where much is left, something else than the library's effects is at
    work, and what was named may be its shadow. times_floor: the gap that is left over the noise floor, the largest of
    all horizons."""
    most = 1.0 if verdict == "effects" else MOST_PARTIAL
    shadow = max(most - SHADOW * float(np.log(max(times_floor / AS_GOOD, 1.0))), LEAST_SURE)
    return MOST_SURE * (1.0 - unexplained) * shadow


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
