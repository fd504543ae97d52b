"""Which candidates resemble what is left: one batch with every candidate at a few probe values.

The screening looks at part of the windows, each only for its first half: it has to order candidates, not to fit them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from residual_mpc.diagnosis.data.subsampling import shorten
from residual_mpc.diagnosis.fit.least_squares import Fit, on_problem
from residual_mpc.diagnosis.predict.problem import Problem, on_part, part_of, tolerating, weighed
from residual_mpc.diagnosis.search.between_probes import between_probes
from residual_mpc.diagnosis.search.settings import SearchSettings
from residual_mpc.effects.library import BY_NAME
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 96  # probes replayed at once: bounds the memory


@dataclass(frozen=True)
class ScreenedTerm:
    """A candidate worth fitting: where to start, the drop in cost that a line search along the probe promises, how
    much of that drop is in the channels that the gap compares, how much it removes of the squared gap itself (in
    which every channel counts by the size of its motion, so that one whose cause is still missing counts in full), and
    how far the probe moves the prediction (whitened norm, after what the free parameters can absorb). closing: where
    the same line search for the squared gap ends, None where that is the probe."""

    term: Term
    start: Values
    gain: float
    compared: float
    gap: float
    reach: float
    closing: Values | None = None


def screen(
    problem: Problem, current: Fit, candidates: tuple[Term, ...], settings: SearchSettings
) -> list[ScreenedTerm]:
    """The best lead of each probe, and of further doses of thresholds, largest gain first; those of the same term stay
    apart.

    Where there are many probes (an arm of many joints), all of them are tried on a quarter of the windows, and only
    the better third of them on the others as well: better by any of the gains.
    """
    small, current, weight = _on_smaller(problem, current, settings=settings)
    probes = _probes(problem, candidates)
    if len(probes) * _steps(small) <= settings.screen.many:
        leads = _leads(small, current, probes, weight)
        between = between_probes(problem.space, leads, weight * current.cost)
        return sorted(leads + _best_of_terms(_leads(small, current, between, weight)), key=_gain)
    leads = _by_quarter(small, current, probes, weight, settings=settings)
    between = between_probes(problem.space, leads, weight * current.cost)
    good = {id(lead) for key in (_gain, _compared, _gap) for lead in sorted(leads, key=key)[: len(leads) // 3]}
    again = [p for p, lead in zip(probes, leads, strict=True) if id(lead) in good]
    # a threshold's lead starts at its own dose
    again += [
        (lead.term, lead.start)
        for lead in _best_of_terms(_by_quarter(small, current, between, weight, settings=settings))
    ]
    leads = [lead for lead in leads if id(lead) not in good] + _leads(small, current, again, weight)
    return sorted(leads, key=_gain)


def _best_of_terms(leads: list[ScreenedTerm]) -> list[ScreenedTerm]:
    """Of each term the best lead by the likelihood and by the gap: its other doses would crowd out other effects."""
    best = {(lead.term, key): lead for key in (_gain, _gap) for lead in sorted(leads, key=key, reverse=True)}
    return list({id(lead): lead for lead in best.values()}.values())


def glance(
    problem: Problem, current: Fit, candidates: tuple[Term, ...], many: int | None = None, *, settings: SearchSettings
) -> list[ScreenedTerm]:
    """As `screen`, less sharp: by a quarter of the windows alone where all probes would cost more than `many`
    simulation steps."""
    small, current, weight = _on_smaller(problem, current, settings=settings)
    probes = _probes(problem, candidates)
    many = settings.screen.many if many is None else many
    if len(probes) * _steps(small) <= many:
        return sorted(_leads(small, current, probes, weight), key=_gain)
    return sorted(_by_quarter(small, current, probes, weight, settings=settings), key=_gain)


def best_leads(problem: Problem, current: Fit, candidates: tuple[Term, ...]) -> list[ScreenedTerm]:
    """The best lead of each candidate by what it removes of the squared gap, largest first."""
    leads = sorted(_leads(problem, current, _probes(problem, candidates), 1.0), key=_gap)
    first: dict[Term, ScreenedTerm] = {}
    for lead in leads:
        first.setdefault(lead.term, lead)
    return list(first.values())


def reaches(
    problem: Problem, current: Fit, candidates: tuple[Term, ...], enough: float, settings: SearchSettings
) -> dict[Term, float]:
    """How far each candidate's strongest probe moves the prediction, as in ScreenedTerm; where its last one does so
    beyond `enough` by much, from a glance at few windows."""
    small, current, weight = _on_smaller(problem, current, settings=settings)
    last = [(term, problem.space.plausible(term)[-1]) for term in candidates]
    reach = {lead.term: lead.reach for lead in _by_quarter(small, current, last, weight, settings=settings)}
    doubtful = tuple(t for t in candidates if reach[t] < settings.screen.clear * enough)
    reach |= dict.fromkeys(doubtful, 0.0)
    doses = [(term, p) for term in doubtful for p in problem.space.plausible(term)]
    for lead in _leads(small, current, doses, weight):
        reach[lead.term] = max(reach[lead.term], lead.reach)
    return reach


def _on_smaller(problem: Problem, current: Fit, settings: SearchSettings) -> tuple[Problem, Fit, float]:
    small, weight = smaller(problem, current, settings=settings)
    return small, current if small is problem else on_problem(small, current, settings=settings.fit), weight


def _probes(problem: Problem, terms: tuple[Term, ...]) -> list[tuple[Term, Values]]:
    return [(term, p) for term in terms for p in problem.space.probes(term)]


def _by_quarter(
    problem: Problem, current: Fit, probes: Sequence[tuple[Term, Values]], weight: float, settings: SearchSettings
) -> list[ScreenedTerm]:
    """The leads by a quarter of the windows, those that hold most of the cost before others: a limit that is seldom
    reached shows nowhere else."""
    if not probes:
        return []
    quarter = drawn(current.per_window, max(settings.screen.fewest_quick, problem.data.count // 4), power=1.0)
    quick = part_of(problem, quarter > 0, quarter[quarter > 0])
    return _leads(quick, on_problem(quick, current, settings=settings.fit), probes, weight)


def _leads(problem: Problem, current: Fit, probes: Sequence[tuple[Term, Values]], weight: float) -> list[ScreenedTerm]:
    basis = absorbed(current)
    leads: list[ScreenedTerm] = []
    for a in range(0, len(probes), ROWS):
        part = probes[a : a + ROWS]
        moved = problem.residuals([{**current.values, **p} for _, p in part])
        leads += [
            _lead(problem, current, basis, term, p, r.ravel(), weight) for (term, p), r in zip(part, moved, strict=True)
        ]
    return leads


def _gain(lead: ScreenedTerm) -> float:
    return -lead.gain


def _compared(lead: ScreenedTerm) -> float:
    return -lead.compared


def _gap(lead: ScreenedTerm) -> float:
    return -lead.gap


def rankings(leads: Sequence[ScreenedTerm]) -> list[list[ScreenedTerm]]:
    """The leads, best first, by each of the gains."""
    return [sorted(leads, key=key) for key in (_gain, _compared, _gap)]


def _steps(problem: Problem) -> int:
    """Simulation steps of one hypothesis."""
    return problem.data.count * max(b.steps for b in problem.data.blocks)


def smaller(problem: Problem, current: Fit, settings: SearchSettings) -> tuple[Problem, float]:
    """The problem thinned to few simulation steps, and how many times larger than that thinned one its cost is.

    Windows are drawn where the current fit leaves most, each standing for as many as it was drawn from: an even choice
    loses a cause that shows in few of them, such as a limit that is seldom reached.
    """
    tuned = settings.screen
    data = problem.data
    steps = max(b.steps for b in data.blocks)
    if data.count * steps <= tuned.steps:
        return problem, 1.0
    half = shorten(data, 0.5) if data.count * steps > 2 * tuned.steps and data.horizon > tuned.shortest else data
    if _first(current, half.y.shape[1], data.y.shape[1]) < tuned.late:
        half = data
    steps = max(b.steps for b in half.blocks)
    stands_for = drawn(current.per_window, max(tuned.fewest, tuned.steps // steps))
    pick = stands_for > 0
    few = half.take(pick)
    m, c = few.y.shape[1:]
    k = problem.sensitivity.shape[2]
    sensitivity = problem.sensitivity.reshape(data.count, -1, c, k)[pick, :m].reshape(len(few.start), m * c, k)
    count = stands_for[pick] if problem.count is None else stands_for[pick] * problem.count[pick]
    small = weighed(problem.replays.of(few, pick), sensitivity, 1.0 / problem.weight, problem.motion)
    small = tolerating(replace(small, count=count), on_part(problem, pick, m))
    # errors grow within a window, so that the half that is left out holds more of a drop in cost than its samples say
    return small, tuned.growth * data.y.shape[1] / m if half is not data else 1.0


def _first(current: Fit, samples: int, of: int) -> float:
    """The share that lies in the windows' first samples of what is beyond one unit a sample."""
    square = current.r.reshape(len(current.r), of, -1) ** 2
    beyond = square - (square > 0.0)
    first, whole = (np.maximum(part.sum(axis=(1, 2)), 0.0).sum() for part in (beyond[:, :samples], beyond))
    return float(first / whole) if whole > 0.0 else 1.0


def drawn(cost: np.ndarray, most: int, power: float = 0.5) -> np.ndarray:
    """(W,) how many windows each one stands for, 0 where it is left out; about `most` are not. Systematic sampling
    (Saerndal, Swensson and Wretman, Model Assisted Survey Sampling, 1992, section 3.4.2): half of the chance evenly,
    half by that power of a window's cost, so that nothing is left out for certain."""
    size = np.maximum(cost, 0.0) ** power
    chance = 0.5 / len(cost) + 0.5 * size / max(float(size.sum()), 1e-300)
    expected = chance / chance.sum() * most
    times = np.diff(np.floor(np.concatenate([[0.0], np.cumsum(expected)]) + 0.5))
    return np.where(expected >= 1.0, 1.0, times / expected)  # what is sure to be drawn stands for itself alone


def absorbed(current: Fit) -> np.ndarray:
    """(n, P) orthonormal basis of what the free parameters of the current fit can follow."""
    if not current.knobs:
        return np.zeros((current.r.size, 0))
    q, r = np.linalg.qr(current.jacobian.reshape(-1, len(current.knobs)))
    return np.asarray(q[:, np.abs(np.diag(r)) > 1e-9 * max(np.abs(np.diag(r)).max(), 1e-30)])


def _lead(
    problem: Problem, current: Fit, basis: np.ndarray, term: Term, probe: Values, moved: np.ndarray, weight: float
) -> ScreenedTerm:
    r = current.r.ravel()
    plain = moved - r
    delta = plain - basis @ (basis.T @ plain)
    square = float(delta @ delta)
    direct = current.cost - float(moved @ moved)
    if square < 1e-12:
        return ScreenedTerm(term, probe, 0.0, 0.0, 0.0, 0.0)
    reach = (weight * square) ** 0.5
    room = _room(problem, probe)
    alpha = float(np.clip(-(r @ delta) / square, *room))
    along = -(2.0 * alpha * float(r @ delta) + alpha**2 * square)
    threshold = any(BY_NAME[k.effect].parameter(k.parameter).threshold for k in probe)
    mask, size = compared_mask(problem), gap_weights(problem)
    if direct >= along or threshold:
        drop = r * r - moved * moved
        return ScreenedTerm(term, probe, weight * direct, weight * float(drop[mask].sum()), float(size @ drop), reach)
    steepest, curvature = float(size @ (r * delta)), float(size @ (delta * delta))
    best = float(np.clip(-steepest / max(curvature, 1e-300), *room))
    part = -(2.0 * alpha * float(r[mask] @ delta[mask]) + alpha**2 * float(delta[mask] @ delta[mask]))
    start, closing = ({k: _between(problem, k, v, x) for k, v in probe.items()} for x in (alpha, best))
    gap = -(2.0 * best * steepest + best**2 * curvature)
    return ScreenedTerm(term, start, weight * along, weight * part, gap, reach, closing)


def gap_weights(problem: Problem) -> np.ndarray:
    """(W * M * C,) what turns the squares of whitened residuals into squares relative to the motion."""
    each = (1.0 / (problem.weight * problem.motion)) ** 2
    return np.broadcast_to(each, problem.data.y.shape).ravel()


def compared_mask(problem: Problem) -> np.ndarray:
    """(W * M * C,) bool: the samples of channels that the gap compares."""
    data = problem.data
    return np.broadcast_to(data.compared[:, None, :], data.y.shape).ravel()


def _between(problem: Problem, knob: Knob, value: float, alpha: float) -> float:
    null = problem.space.null(knob)
    low, high = problem.space.bounds(knob)
    if BY_NAME[knob.effect].parameter(knob.parameter).shape:
        return value
    if not np.isfinite(null):  # infinity does nothing
        # a little of a limit is a limit near the peak, a little of a spring is a stiffer one
        limit = BY_NAME[knob.effect].parameter(knob.parameter).threshold
        return float(np.clip(value if limit else value / alpha, low, high))
    return float(np.clip(null + alpha * (value - null), low, high))


def _room(problem: Problem, probe: Values) -> tuple[float, float]:
    """How far along null -> probe the bounds let one go; backwards only where a parameter may go below its null."""
    low, high = -3.0, 3.0
    for knob, value in probe.items():
        if BY_NAME[knob.effect].parameter(knob.parameter).shape:
            continue
        null, (a, b) = problem.space.null(knob), problem.space.bounds(knob)
        if not np.isfinite(null):
            return (0.2, 1.0) if BY_NAME[knob.effect].parameter(knob.parameter).threshold else (0.1, 3.0)
        step = value - null
        if abs(step) < 1e-12:
            continue
        ends = sorted(((a - null) / step, (b - null) / step))
        low, high = max(low, ends[0]), min(high, ends[1])
    return min(low, 0.0), max(high, 1e-3)
