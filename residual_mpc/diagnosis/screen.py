"""Which candidates resemble what is left: one batch with every candidate at a few probe values."""

from dataclasses import dataclass

import numpy as np

from residual_mpc.diagnosis.fit import Fit
from residual_mpc.diagnosis.problem import Problem
from residual_mpc.models.settings import Knob, Term, Values

ROWS = 64  # probes replayed at once: bounds the memory


@dataclass(frozen=True)
class Lead:
    """A candidate worth fitting: where to start, the drop in cost that a line search along the probe promises, and how far
    the probe moves the prediction (whitened norm, after what the free parameters can absorb)."""

    term: Term
    start: Values
    gain: float
    reach: float


def screen(problem: Problem, current: Fit, candidates: tuple[Term, ...]) -> list[Lead]:
    """The best lead of each probe, largest gain first; probes of the same term stay apart."""
    probes = [(term, p) for term in candidates for p in problem.space.probes(term)]
    basis = _absorbed(current)
    leads: list[Lead] = []
    for a in range(0, len(probes), ROWS):
        part = probes[a : a + ROWS]
        moved = problem.residuals([{**current.values, **p} for _, p in part])
        leads += [
            _lead(problem, current, basis, term, p, r.ravel()) for (term, p), r in zip(part, moved, strict=True)
        ]
    return sorted(leads, key=lambda lead: -lead.gain)


def _absorbed(current: Fit) -> np.ndarray:
    """(n, P) orthonormal basis of what the free parameters of the current fit can follow."""
    j = current.jacobian.reshape(-1, len(current.knobs))
    if not j.shape[1]:
        return j
    q, r = np.linalg.qr(j)
    return np.asarray(q[:, np.abs(np.diag(r)) > 1e-9 * max(np.abs(np.diag(r)).max(), 1e-30)])


def _lead(
    problem: Problem, current: Fit, basis: np.ndarray, term: Term, probe: Values, moved: np.ndarray
) -> Lead:
    r = current.r.ravel()
    delta = moved - r
    delta = delta - basis @ (basis.T @ delta)
    square = float(delta @ delta)
    direct = current.cost - float(moved @ moved)
    if square < 1e-12:
        return Lead(term, probe, 0.0, 0.0)
    alpha = float(np.clip(-(r @ delta) / square, *_room(problem, probe)))
    along = -(2.0 * alpha * float(r @ delta) + alpha**2 * square)
    if direct >= along:
        return Lead(term, probe, direct, square**0.5)
    start = {k: _between(problem, k, v, alpha) for k, v in probe.items()}
    return Lead(term, start, along, square**0.5)


def _between(problem: Problem, knob: Knob, value: float, alpha: float) -> float:
    null = problem.space.null(knob)
    low, high = problem.space.bounds(knob)
    if not np.isfinite(null):  # a limit: infinity does nothing; a little of it is a limit near the peak
        return float(np.clip(value, low, high))
    return float(np.clip(null + alpha * (value - null), low, high))


def _room(problem: Problem, probe: Values) -> tuple[float, float]:
    """How far along null -> probe the bounds let one go; backwards only where a parameter may go below its null."""
    low, high = -3.0, 3.0
    for knob, value in probe.items():
        null, (a, b) = problem.space.null(knob), problem.space.bounds(knob)
        if not np.isfinite(null):
            return 0.2, 1.0
        step = value - null
        if abs(step) < 1e-12:
            continue
        ends = sorted(((a - null) / step, (b - null) / step))
        low, high = max(low, ends[0]), min(high, ends[1])
    return min(low, 0.0), max(high, 1e-3)
